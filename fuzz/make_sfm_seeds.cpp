// SPDX-License-Identifier: MIT
// Tiny reconstructions and the files of their shards.
#include "tarsier/core/progress.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sqlite.h"
#include "tarsier/sfm/dense/depth_map.h"
#include "tarsier/sfm/mapper/packed_file.h"
#include "tarsier/sfm/pipelines/colmap_database.h"
#include "tarsier/sfm/pipelines/plan.h"
#include "tarsier/sfm/pipelines/shard_files.h"
#include "tarsier/sfm/scene/colmap_binary.h"
#include "tarsier/sfm/scene/testing_model.h"
#include "tarsier/sfm/surface/surface_files.h"

#include "seeds.h"
#include <filesystem>
#include <string>
#include <vector>

namespace tarsier {
namespace {

namespace fs = std::filesystem;

// Some features at arbitrary positions.
sfm::Features some_features() {
  sfm::Features features;
  features.points = {{1, 2}, {30, 40}, {5.5F, 6}};
  features.sizes = {2, 3, 4};
  features.colors.assign(3, cv::Vec3b(10, 20, 30));
  features.descriptors = texture({128, 3});
  return features;
}

// The file without its checksum, for a target that adds the checksum itself.
void write_without_checksum(const std::string& path) {
  const std::string bytes = read_file(path, 1'000'000);
  write_file_atomically(path, bytes.substr(sfm::kPackedMagic.size() + 64));
}

void shards() {
  const std::string folder = fs::path(seed("sfm_plan", "")).parent_path().string();
  sfm::PipelineOptions options;
  options.camera = geometry::Camera{64, 48, 50, 50, 31.5, 23.5};
  write_image(seed("sfm_plan", "a.png"), texture({64, 48}));
  write_image(seed("sfm_plan", "b.png"), texture({48, 64}));
  const std::vector<sfm::Input> inputs = {{"a.png", seed("sfm_plan", "a.png")},
                                          {"b.png", seed("sfm_plan", "b.png")}};
  NoProgress progress;
  (void)sfm::write_plan(folder, inputs, options, 2, progress, {});
  for (const sfm::Input& input : inputs) fs::remove(input.path);
  fs::rename(folder + "/plan.json", seed("sfm_plan", "two.json"));

  sfm::ShardInfo info;
  info.count = 1;
  info.left_out = {{1, "b.png: no image"}};
  const std::string path = seed("shard_info", "one");
  sfm::write_shard_info(path, info);

  sfm::ImageFeatures image;
  image.size = {64, 48};
  image.lens = {*options.camera, "given"};
  image.body = "a camera";
  image.key = "00";
  image.features = some_features();
  (void)sfm::write_feature_shard(seed("feature_shard", "one"), std::vector{image, image});
  write_without_checksum(seed("feature_shard", "one"));
  (void)sfm::write_image_pairs(seed("image_pairs", "three"),
                               std::vector<sfm::ImagePair>{{0, 1}, {0, 2}, {1, 2}});
  write_without_checksum(seed("image_pairs", "three"));
  sfm::Pair pair;
  pair.second = 1;
  pair.matches = 3;
  pair.view.inliers = {{0, 1}, {2, 2}};
  (void)sfm::write_match_shard(seed("match_shard", "one"), std::vector{pair});
  write_without_checksum(seed("match_shard", "one"));
  sfm::ClusterModels cluster;
  cluster.images = {0, 2, 3, 4, 7};
  cluster.is_own = {1, 1, 0, 1, 0};
  cluster.cameras = {0, 0, 0, 0, 0};
  cluster.reasons = {"", "too few points", "", "", ""};
  cluster.models = {sfm::packed(sfm::synthetic_model())};
  cluster.rejected_pairs = {{0, 2}, {3, 7}};
  (void)sfm::write_cluster_models(seed("cluster_models", "one"), cluster);
  write_without_checksum(seed("cluster_models", "one"));
}

void reconstructions() {
  const std::string folder = seed("colmap_binary", "") + "model";
  sfm::write_colmap_binary(folder, sfm::synthetic_model());
  std::string all;
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"})
    all += (all.empty() ? "" : "%%%\n") + read_file(folder + "/" + name, 1'000'000);
  fs::remove_all(folder);
  write_file_atomically(seed("colmap_binary", "wall"), all);

  sfm::ColmapDatabase database;
  database.cameras = {{geometry::Camera{64, 48, 50, 50, 31.5, 23.5}, true}};
  database.images = {{"a.png", 0, some_features()}, {"b.png", 0, some_features()}};
  database.pairs = {{0, 1, {{0, 1}, {2, 2}}, {}}};
  const std::string path = seed("colmap_database", "two.db");
  fs::remove(path);
  sfm::write_colmap_database(path, database);
  const std::string with_priors = seed("colmap_database", "priors.db");
  fs::remove(with_priors);
  sfm::write_colmap_database(with_priors, database);
  DatabaseKind kind;
  kind.name = "COLMAP database";
  kind.application_id = 0;
  kind.versions = {""};
  kind.of_another_program = true;
  // 47 N 8 E, 400 m; and a position of zeros.
  Database(with_priors, kind, DatabaseAccess::kWrite)
      .run(
          "CREATE TABLE pose_priors (pose_prior_id INTEGER PRIMARY KEY NOT NULL, corr_data_id "
          "INTEGER NOT NULL, corr_sensor_id INTEGER NOT NULL, corr_sensor_type INTEGER NOT NULL, "
          "position BLOB, position_covariance BLOB, gravity BLOB, coordinate_system INTEGER NOT "
          "NULL);"
          "INSERT INTO pose_priors VALUES (1, 1, 1, 0, "
          "x'000000000080474000000000000020400000000000007940', NULL, NULL, 0), (2, 2, 1, 0, "
          "zeroblob(24), NULL, NULL, 1);");

  sfm::write_colmap_map(seed("depth_map", "depth.bin"), cv::Mat(6, 8, CV_32FC1, cv::Scalar(2)));
  sfm::write_colmap_map(seed("depth_map", "normals.bin"),
                        cv::Mat(6, 8, CV_32FC3, cv::Scalar(0, 0, -1)));

  sfm::TexturedSurface surface;
  surface.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  surface.mesh.faces = {{0, 2, 1}, {0, 1, 3}};
  sfm::write_surface(seed("surface_ply", "bare.ply"), surface);
  surface.mesh.colors.assign(4, cv::Vec3b(1, 2, 3));
  sfm::write_surface(seed("surface_ply", "colours.ply"), surface);
}

}  // namespace

void reconstruction_seeds() {
  shards();
  reconstructions();
}

}  // namespace tarsier
