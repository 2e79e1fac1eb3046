// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/shard_files.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/json_integer.h"
#include "tarsier/sfm/mapper/packed_records.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>

namespace tarsier::sfm {
namespace {

constexpr NameTable<ShardStage, 4> kStages{"stage",
                                           {{{ShardStage::kFeatures, "features"},
                                             {ShardStage::kPairs, "pairs"},
                                             {ShardStage::kModel, "model"},
                                             {ShardStage::kMatch, "match"}}}};

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr std::int64_t kMaxShardBytes = 16'000'000'000;
constexpr std::int64_t kMaxInfoBytes = 256'000'000;
constexpr int kShardVersion =
    2;  // of the file format, and of the algorithms for features and matches
constexpr std::array<const char*, 3> kLensOrigins = {"given", "EXIF", "guess"};
constexpr int kMaxImageSide = 1'000'000;  // px

std::string writer_of(ShardStage stage) {
  switch (stage) {
    case ShardStage::kFeatures:
      return "tarsier sfm features";
    case ShardStage::kModel:
      return "tarsier sfm map";
    case ShardStage::kPairs:
    case ShardStage::kMatch:
      break;
  }
  return "tarsier sfm match";
}

// Opens a packed file with this checksum and calls `read`, which must consume all of it.
template <class Read>
auto read_packed(const std::string& path, const std::string& sum, const Read& read) {
  try {
    PackedReader reader(path, kMaxShardBytes);
    if (reader.sum() != sum)
      throw InputError(path, "does not match the checksum in its .done file");
    if (reader.get<std::int32_t>() != kShardVersion)
      throw InputError(path, "was written by another version of this program");
    auto result = read(reader);
    if (!reader.is_at_end()) throw Damaged();
    return result;
  } catch (const Damaged&) {
    throw InputError(path, "is damaged");
  }
}

PackedWriter packed_writer() {
  PackedWriter writer;
  writer.put(static_cast<std::int32_t>(kShardVersion));
  return writer;
}

ImageFeatures get_image(PackedReader& reader) {
  ImageFeatures image;
  image.input = reader.get<std::int32_t>();
  const auto size = reader.get<std::array<std::int32_t, 2>>();
  image.size = {size[0], size[1]};
  image.lens.camera = get_camera(reader);
  const std::string from = reader.get_text();
  const auto* const origin = std::find(kLensOrigins.begin(), kLensOrigins.end(), from);
  if (origin == kLensOrigins.end() || image.input < 0 || size[0] < 1 || size[1] < 1 ||
      size[0] > kMaxImageSide || size[1] > kMaxImageSide ||
      image.lens.camera.lens != geometry::Lens::kPinhole) {
    throw Damaged();
  }
  image.lens.source = *origin;
  image.body = reader.get_text();
  image.key = reader.get_text();
  image.turns = reader.get<std::int32_t>();
  if (image.turns < 0 || image.turns > 3) throw Damaged();
  image.features = get_features(reader);
  return image;
}

std::vector<std::array<std::int32_t, 2>> numbers_of(std::span<const ImagePair> pairs) {
  std::vector<std::array<std::int32_t, 2>> numbers;
  for (const auto& [first, second] : pairs) numbers.push_back({first, second});
  return numbers;
}

std::vector<ImagePair> get_pairs(PackedReader& reader) {
  std::vector<ImagePair> pairs;
  for (const auto& numbers : reader.get_all<std::array<std::int32_t, 2>>()) {
    const ImagePair pair(numbers[0], numbers[1]);
    if (pair.first < 0 || pair.first >= pair.second || (!pairs.empty() && pair <= pairs.back()))
      throw Damaged();
    pairs.push_back(pair);
  }
  return pairs;
}

bool is_valid(const PackedModel& model) {
  return model.poses.size() == model.registered.size() &&
         std::all_of(model.poses.begin(), model.poses.end(),
                     [](const geometry::Rigid3& pose) {
                       return geometry::is_rotation(pose.rotation) && pose.translation.allFinite();
                     }) &&
         std::all_of(model.positions.begin(), model.positions.end(),
                     [](const Eigen::Vector3d& position) { return position.allFinite(); }) &&
         std::all_of(model.cameras.begin(), model.cameras.end(),
                     [](const geometry::Camera& camera) {
                       return camera.lens == geometry::Lens::kPinhole;
                     });
}

bool is_valid(const ClusterModels& cluster) {
  const std::size_t count = cluster.images.size();
  if (cluster.is_own.size() != count || cluster.cameras.size() != count ||
      cluster.reasons.size() != count ||
      !std::is_sorted(cluster.images.begin(), cluster.images.end(), std::less_equal<>()) ||
      (count > 0 && cluster.images.front() < 0))
    return false;
  return std::all_of(cluster.models.begin(), cluster.models.end(), [&](const PackedModel& model) {
    return is_valid(model) &&
           std::all_of(cluster.cameras.begin(), cluster.cameras.end(), [&](int camera) {
             return camera >= 0 && static_cast<std::size_t>(camera) < model.cameras.size();
           });
  });
}

ShardInfo info_of(const Json& json) {
  ShardInfo info;
  for (const ShardStage stage :
       {ShardStage::kFeatures, ShardStage::kPairs, ShardStage::kMatch, ShardStage::kModel})
    if (json.at("stage") == name_of(stage)) info.stage = stage;
  info.shard = json_integer<int>(json.at("shard").at(0));
  info.shards = json_integer<int>(json.at("shard").at(1));
  info.plan = json.at("plan");
  info.from = json.at("from");
  info.sha256 = json.at("sha256");
  info.count = json_integer<std::int64_t>(json.at("count"));
  for (const Json& entry : json.at("left_out"))
    info.left_out.emplace_back(json_integer<int>(entry.at(0)), entry.at(1).get<std::string>());
  return info;
}

bool is_valid(const Json& json, const ShardInfo& info) {
  return json.at("version") == kShardVersion && json.at("stage") == name_of(info.stage) &&
         json.at("written_by") == writer_of(info.stage) && info.shards >= 1 &&
         info.shards <= kMaxShards && info.shard >= 1 && info.shard <= info.shards &&
         info.count >= 0 && std::is_sorted(info.left_out.begin(), info.left_out.end());
}

}  // namespace

std::string_view name_of(ShardStage stage) { return kStages.name(stage); }

std::string shard_path(const std::string& folder, ShardStage stage, int shard, int shards) {
  const std::string name = stage == ShardStage::kPairs
                               ? std::string(name_of(stage))
                               : fmt::format("{}-{}-of-{}", name_of(stage), shard, shards);
  return (fs::path(folder) / name).string();
}

ShardRange range_of_shard(std::int64_t count, int shard, int shards) {
  TARSIER_REQUIRE(count >= 0 && shard >= 1 && shard <= shards, "shard {} of {}", shard, shards);
  const auto border = [&](std::int64_t k) {
    return count / shards * k + count % shards * k / shards;
  };
  return {border(shard - 1), border(shard)};
}

void write_shard_info(const std::string& path, const ShardInfo& info) {
  nlohmann::ordered_json json{{"written_by", writer_of(info.stage)},
                              {"version", kShardVersion},
                              {"stage", name_of(info.stage)},
                              {"shard", {info.shard, info.shards}},
                              {"plan", info.plan},
                              {"from", info.from},
                              {"sha256", info.sha256},
                              {"count", info.count},
                              {"left_out", nlohmann::ordered_json::array()}};
  for (const auto& [input, reason] : info.left_out) json["left_out"].push_back({input, reason});
  write_file_atomically(path + ".done",
                        json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n");
}

ShardInfo read_shard_info(const std::string& path) {
  const std::string info_path = path + ".done";
  std::error_code ignored;
  if (!fs::exists(info_path, ignored)) {
    throw InputError(path, fs::exists(path, ignored) ? "is not finished (its .done file is missing)"
                                                     : "is missing");
  }
  const Json json = parse_json(read_file(info_path, kMaxInfoBytes), info_path,
                               {.max_bytes = kMaxInfoBytes, .max_values = kMaxInfoBytes});
  try {
    ShardInfo info = info_of(json);
    if (!is_valid(json, info)) throw InputError(info_path, "is not a valid description of a shard");
    return info;
  } catch (const Json::exception&) {
    throw InputError(info_path, "is not a valid description of a shard");
  }
}

std::string write_feature_shard(const std::string& path, std::span<const ImageFeatures> images) {
  PackedWriter writer = packed_writer();
  writer.put(static_cast<std::uint64_t>(images.size()));
  for (const ImageFeatures& image : images) {
    writer.put(static_cast<std::int32_t>(image.input));
    writer.put(std::array<std::int32_t, 2>{image.size.width, image.size.height});
    put(writer, image.lens.camera);
    writer.put(std::string(image.lens.source));
    writer.put(image.body);
    writer.put(image.key);
    writer.put(static_cast<std::int32_t>(image.turns));
    put(writer, image.features);
  }
  return writer.write(path);
}

std::vector<ImageFeatures> read_feature_shard(const std::string& path, const std::string& sum) {
  return read_packed(path, sum, [](PackedReader& reader) {
    std::vector<ImageFeatures> images;
    const auto count = reader.get<std::uint64_t>();
    for (std::uint64_t k = 0; k < count; ++k) images.push_back(get_image(reader));
    return images;
  });
}

std::string write_image_pairs(const std::string& path, std::span<const ImagePair> pairs) {
  PackedWriter writer = packed_writer();
  writer.put(numbers_of(pairs));
  return writer.write(path);
}

std::vector<ImagePair> read_image_pairs(const std::string& path, const std::string& sum) {
  return read_packed(path, sum, [](PackedReader& reader) { return get_pairs(reader); });
}

std::string write_match_shard(const std::string& path, std::span<const Pair> pairs) {
  PackedWriter writer = packed_writer();
  writer.put(static_cast<std::uint64_t>(pairs.size()));
  for (const Pair& pair : pairs) {
    writer.put(std::array<std::int32_t, 3>{pair.first, pair.second, pair.matches});
    put(writer, pair.view);
  }
  return writer.write(path);
}

std::vector<Pair> read_match_shard(const std::string& path, const std::string& sum) {
  return read_packed(path, sum, [](PackedReader& reader) {
    std::vector<Pair> pairs;
    const auto count = reader.get<std::uint64_t>();
    for (std::uint64_t k = 0; k < count; ++k) {
      const auto numbers = reader.get<std::array<std::int32_t, 3>>();
      Pair pair;
      pair.first = numbers[0];
      pair.second = numbers[1];
      pair.matches = numbers[2];
      pair.view = get_two_view(reader);
      if (pair.first < 0 || pair.first >= pair.second || pair.matches < 0) throw Damaged();
      pairs.push_back(std::move(pair));
    }
    return pairs;
  });
}

int ClusterModels::registered() const {
  std::set<int> all;
  for (const PackedModel& model : models)
    all.insert(model.registered.begin(), model.registered.end());
  return static_cast<int>(all.size());
}

std::string write_cluster_models(const std::string& path, const ClusterModels& cluster) {
  PackedWriter writer = packed_writer();
  writer.put(cluster.images);
  writer.put(cluster.is_own);
  writer.put(cluster.cameras);
  for (const std::string& reason : cluster.reasons) writer.put(reason);
  writer.put(static_cast<std::uint64_t>(cluster.models.size()));
  for (const PackedModel& model : cluster.models) put(writer, model);
  writer.put(numbers_of(cluster.rejected_pairs));
  return writer.write(path);
}

ClusterModels read_cluster_models(const std::string& path, const std::string& sum) {
  return read_packed(path, sum, [](PackedReader& reader) {
    ClusterModels cluster;
    cluster.images = reader.get_all<int>();
    cluster.is_own = reader.get_all<char>();
    cluster.cameras = reader.get_all<int>();
    for (std::size_t k = 0; k < cluster.images.size(); ++k)
      cluster.reasons.push_back(reader.get_text());
    const auto models = reader.get<std::uint64_t>();
    for (std::uint64_t k = 0; k < models; ++k)  // a wrong count ends with the file
      cluster.models.push_back(get_packed_model(reader));
    cluster.rejected_pairs = get_pairs(reader);
    if (!is_valid(cluster)) throw Damaged();
    return cluster;
  });
}

}  // namespace tarsier::sfm
