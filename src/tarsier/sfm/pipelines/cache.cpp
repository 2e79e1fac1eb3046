// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/cache.h"

#include "tarsier/core/errors.h"
#include "tarsier/sfm/mapper/packed_file.h"
#include "tarsier/sfm/mapper/packed_records.h"

#include <filesystem>
#include <string_view>
#include <system_error>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMaxCacheBytes = 1'000'000'000;
constexpr std::int64_t kMaxFlowBytes = 16'000'000'000;  // one file for all images
constexpr std::string_view kCheckpointEnding = ".mapper";

}  // namespace

std::string cache_key(const std::string& text) { return sha256_of(text).substr(0, 32); }

std::string Cache::path_of(const std::string& key, const char* ending) const {
  return (fs::path(folder_) / (key + ending)).string();
}

std::optional<Features> Cache::features(const std::string& key) const {
  if (folder_.empty()) return std::nullopt;
  try {
    PackedReader reader(path_of(key, ".features"), kMaxCacheBytes);
    return get_features(reader);
  } catch (const Damaged&) {
  } catch (const InputError&) {
  }
  return std::nullopt;
}

void Cache::store(const std::string& key, const Features& features) const {
  if (folder_.empty()) return;
  PackedWriter writer;
  put(writer, features);
  writer.write(path_of(key, ".features"));
}

Cache::Pairs Cache::pairs(const std::string& key) const {
  if (folder_.empty()) return {};
  try {
    PackedReader reader(path_of(key, ".pairs"), kMaxCacheBytes);
    Pairs pairs;
    const auto count = reader.get<std::uint64_t>();
    for (std::uint64_t k = 0; k < count; ++k) {
      const std::string other = reader.get_text();
      PairEntry& entry = pairs[other];
      entry.matches = reader.get<std::int32_t>();
      entry.view = get_two_view(reader);
    }
    return pairs;
  } catch (const Damaged&) {
  } catch (const InputError&) {
  }
  return {};
}

void Cache::store(const std::string& key, const Pairs& pairs) const {
  if (folder_.empty()) return;
  PackedWriter writer;
  writer.put(static_cast<std::uint64_t>(pairs.size()));
  for (const auto& [other, entry] : pairs) {
    writer.put(other);
    writer.put(static_cast<std::int32_t>(entry.matches));
    put(writer, entry.view);
  }
  writer.write(path_of(key, ".pairs"));
}

std::optional<FlowResult> Cache::flow(const std::string& key) const {
  if (folder_.empty()) return std::nullopt;
  try {
    PackedReader reader(path_of(key, ".flow"), kMaxFlowBytes);
    FlowResult flow;
    const auto images = reader.get<std::uint64_t>();
    for (std::uint64_t k = 0; k < images; ++k) {
      Features& features = flow.features.emplace_back();
      features.points = reader.get_all<cv::Point2f>();
      features.sizes = reader.get_all<float>();
      features.colors = reader.get_all<cv::Vec3b>();
      if (features.sizes.size() != features.points.size() ||
          features.colors.size() != features.points.size()) {
        return std::nullopt;
      }
    }
    const auto pairs = reader.get<std::uint64_t>();
    for (std::uint64_t k = 0; k < pairs; ++k) {
      FlowMatches& pair = flow.pairs.emplace_back();
      pair.first = reader.get<std::int32_t>();
      pair.second = reader.get<std::int32_t>();
      pair.matches = reader.get_all<Match>();
      const auto is_image = [&](int index) {
        return index >= 0 && static_cast<std::uint64_t>(index) < images;
      };
      if (!is_image(pair.first) || !is_image(pair.second)) return std::nullopt;
    }
    return flow;
  } catch (const Damaged&) {
  } catch (const InputError&) {
  }
  return std::nullopt;
}

void Cache::store(const std::string& key, const FlowResult& flow) const {
  if (folder_.empty()) return;
  PackedWriter writer;
  writer.put(static_cast<std::uint64_t>(flow.features.size()));
  for (const Features& features : flow.features) {
    writer.put(features.points);
    writer.put(features.sizes);
    writer.put(features.colors);
  }
  writer.put(static_cast<std::uint64_t>(flow.pairs.size()));
  for (const FlowMatches& pair : flow.pairs) {
    writer.put(static_cast<std::int32_t>(pair.first));
    writer.put(static_cast<std::int32_t>(pair.second));
    writer.put(pair.matches);
  }
  writer.write(path_of(key, ".flow"));
}

std::optional<MapperState> Cache::checkpoint(const std::string& key) const {
  if (folder_.empty()) return std::nullopt;
  return read_checkpoint(path_of(key, kCheckpointEnding.data()));
}

void Cache::store(const std::string& key, const MapperState& state) const {
  if (folder_.empty()) return;
  const fs::path path = path_of(key, kCheckpointEnding.data());
  std::error_code error;
  const bool is_first = !fs::exists(path, error);
  write_checkpoint(path.string(), state);
  if (!is_first) return;
  // Checkpoints for other options or images are removed, as they are large.
  const auto root = [](const fs::path& file) {
    const std::string stem = file.stem().string();
    return stem.substr(0, stem.find(kRemappedSuffix.front()));
  };
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, error)) {
    if (entry.path().extension() == kCheckpointEnding && root(entry.path()) != root(path))
      fs::remove(entry.path(), error);
  }
}

}  // namespace tarsier::sfm
