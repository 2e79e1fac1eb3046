// SPDX-License-Identifier: MIT
// Reconstructions, image data files, and targets.
#include "tarsier/core/errors.h"
#include "tarsier/planar/image_targets/detect.h"
#include "tarsier/planar/image_targets/target_io.h"
#include "tarsier/sfm/dense/depth_map.h"
#include "tarsier/sfm/features/pairs.h"
#include "tarsier/sfm/mapper/evaluation.h"
#include "tarsier/sfm/mapper/packed_file.h"
#include "tarsier/sfm/pipelines/colmap_database.h"
#include "tarsier/sfm/pipelines/plan.h"
#include "tarsier/sfm/pipelines/shard_files.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/colmap_binary.h"
#include "tarsier/sfm/scene/exif.h"
#include "tarsier/sfm/surface/surface_files.h"

#include "fuzz.h"
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace tarsier::fuzz {

using namespace tarsier::sfm;

TARSIER_FUZZ_TARGET(colmap, kBytes) {
  const auto parts = parts_of(input, 3);
  file_of(parts[0], "cameras.txt");
  file_of(parts[1], "images.txt");
  file_of(parts[2], "points3D.txt");
  const Model model = read_colmap(scratch_folder());
  const std::string copy = scratch_folder() + "/copy";
  write_colmap(copy, model);
  expect(read_colmap(copy).points.size() == model.points.size(), "points change when written");
}

TARSIER_FUZZ_TARGET(colmap_binary, kBytes) {
  const auto parts = parts_of(input, 3);
  file_of(parts[0], "cameras.bin");
  file_of(parts[1], "images.bin");
  file_of(parts[2], "points3D.bin");
  const Model model = read_colmap_binary(scratch_folder());
  const std::string copy = scratch_folder() + "/copy";
  write_colmap_binary(copy, model);
  expect(read_colmap_binary(copy).points.size() == model.points.size(),
         "points change when written");
}

TARSIER_FUZZ_TARGET(colmap_database, kBytes) {
  const std::string path = file_of(input, "database.db");
  const ColmapDatabase database = read_colmap_database(path);
  const auto has = [&](int image, int feature) {
    return feature >= 0 &&
           static_cast<std::size_t>(feature) <
               database.images[static_cast<std::size_t>(image)].features.points.size();
  };
  for (const auto& pair : database.pairs)
    for (const Match& match : pair.matches)
      expect(has(pair.first, match.first) && has(pair.second, match.second),
             "a match of no feature");
  for (const ColmapPosePrior& prior : read_colmap_pose_priors(path))
    expect(prior.position.allFinite(), "a pose prior that is no position");
}

TARSIER_FUZZ_TARGET(depth_map, kBytes) {
  const std::string path = file_of(input, "map.bin");
  int read = 0;
  for (const int channels : {1, 3}) {
    try {
      const cv::Mat map = read_colmap_map(path, channels);
      expect(map.channels() == channels && map.depth() == CV_32F, "a map of another kind");
      ++read;
    } catch (const Error&) {
      if (channels == 3 && read == 0) throw;
    }
  }
}

TARSIER_FUZZ_TARGET(surface_ply, kBytes) {
  const SurfaceMesh mesh = read_surface(file_of(input, "mesh.ply"));
  mesh.check();
  const std::string copy = scratch_folder() + "/copy.ply";
  write_surface(copy, {mesh, std::nullopt});
  expect(read_surface(copy).faces == mesh.faces, "faces change when written");
}

TARSIER_FUZZ_TARGET(sfm_plan, kJson) {
  file_of(input, "plan.json");
  file_of("", "pairs.txt");
  const Plan plan = read_plan(scratch_folder());
  expect(plan.images.size() >= 2 && plan.shards >= 1, "a plan of nothing");
  plan.options.check();
}

TARSIER_FUZZ_TARGET(shard_info, kJson) {
  file_of(input, "shard.done");
  const ShardInfo info = read_shard_info(scratch_folder() + "/shard");
  expect(info.shard >= 1 && info.shard <= info.shards, "a shard of no plan");
}

// The contents of a packed file with a correct checksum: everything behind it must be checked.
static std::string packed_file_of(Bytes input, std::string& sum) {
  sum = sha256_of(text_of(input));
  return file_of(std::string(kPackedMagic) + sum + std::string(text_of(input)), "shard");
}

TARSIER_FUZZ_TARGET(feature_shard, kBytes) {
  std::string sum;
  const std::string path = packed_file_of(input, sum);
  for (const ImageFeatures& image : read_feature_shard(path, sum)) {
    const Features& features = image.features;
    expect(features.sizes.size() == features.points.size() &&
               features.colors.size() == features.points.size(),
           "features with gaps");
    image.lens.camera.check();
  }
}

TARSIER_FUZZ_TARGET(match_shard, kBytes) {
  std::string sum;
  const std::string path = packed_file_of(input, sum);
  for (const Pair& pair : read_match_shard(path, sum))
    expect(pair.first >= 0 && pair.first < pair.second, "a pair of no images");
}

TARSIER_FUZZ_TARGET(image_pairs, kBytes) {
  std::string sum;
  const std::string path = packed_file_of(input, sum);
  for (const auto& [first, second] : read_image_pairs(path, sum))
    expect(first >= 0 && first < second, "a pair of no images");
}

TARSIER_FUZZ_TARGET(cluster_models, kBytes) {
  std::string sum;
  const std::string path = packed_file_of(input, sum);
  const ClusterModels cluster = read_cluster_models(path, sum);
  expect(cluster.is_own.size() == cluster.images.size() &&
             cluster.reasons.size() == cluster.images.size(),
         "images with gaps");
  std::vector<Image> images(cluster.images.size());
  for (Image& image : images) image.features.resize(100);
  for (const PackedModel& packed : cluster.models) {
    if (!fits(packed, packed.cameras.size(), images)) continue;
    Model model;
    model.images = images;
    model.points.resize(std::min<std::size_t>(10'000, static_cast<std::size_t>(packed.points)));
    if (static_cast<std::int64_t>(model.points.size()) == packed.points) unpack(packed, model);
  }
}

TARSIER_FUZZ_TARGET(exif, kBytes) {
  const Exif exif = parse_exif(text_of(input));
  expect(exif.orientation >= 1 && exif.orientation <= 8, "an orientation that is none");
  const double focal = focal_px_of(exif, {640, 480});
  expect(focal == 0 || (focal >= 64 && focal <= 12'800), "a focal length out of range");
  if (exif.gps) (void)local_metres({*exif.gps, *exif.gps});
  for (const char c : exif.camera) expect(c >= 0x20 && c < 0x7f, "a name that is not printable");
}

TARSIER_FUZZ_TARGET(positions_csv, kBytes) {
  (void)read_positions_csv(file_of(input, "positions.csv"));
}

TARSIER_FUZZ_TARGET(pairs_list, kBytes) {
  const std::vector<std::string> names{"a.jpg", "b.jpg", "c d.jpg", "d.jpg", "c"};
  for (const auto& [first, second] : read_pairs_list(file_of(input, "pairs.txt"), names))
    expect(first >= 0 && first < second && second < 5, "a pair of other images");
}

TARSIER_FUZZ_TARGET(pose_truth, kJson) { (void)read_pose_truth(file_of(input, "truth.jsonl")); }

TARSIER_FUZZ_TARGET(target, kJson) {
  const planar::image_targets::Target read =
      planar::image_targets::read_target(file_of(input, "model.json"));
  (void)planar::image_targets::detect_targets({read}, read.gray);
}

}  // namespace tarsier::fuzz
