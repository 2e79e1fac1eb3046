// SPDX-License-Identifier: MIT
#include "tarsier/sfm/cache.h"

#include "tarsier/core/errors.h"
#include "tarsier/io/atomic_file.h"
#include "tarsier/io/image_file.h"
#include "tarsier/io/sha256.h"

#include <cstring>
#include <filesystem>
#include <string_view>
#include <type_traits>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kMagic = "tarsier-sfm-1\n";
constexpr std::int64_t kMostBytes = 1'000'000'000;
constexpr std::uint64_t kMostItems = 100'000'000;

std::string sha256_of(std::string_view bytes) {
  Sha256 sum;
  sum.add(bytes);
  return sum.hex();
}

// Plain numbers one after the other, the machine's own byte order: the files are nobody else's.
class Writer {
 public:
  template <typename T>
  void put(const T& value) {
    static_assert(std::is_standard_layout_v<T>);  // numbers, and structs of them
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  template <typename T>
  void put(const std::vector<T>& values) {
    static_assert(std::is_standard_layout_v<T>);  // numbers, and structs of them
    put(static_cast<std::uint64_t>(values.size()));
    if (!values.empty())
      bytes_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  void put(const std::string& text) { put(std::vector<char>(text.begin(), text.end())); }

  void write(const std::string& path) const {
    write_file_atomically(path, std::string(kMagic) + sha256_of(bytes_) + bytes_);
  }

 private:
  std::string bytes_;
};

class Damaged {};

class Reader {
 public:
  explicit Reader(const std::string& path) : file_(read_file(path, kMostBytes)) {
    const std::size_t head = kMagic.size() + 64;
    if (file_.size() < head || std::string_view(file_).substr(0, kMagic.size()) != kMagic)
      throw Damaged();
    left_ = std::string_view(file_).substr(head);
    if (sha256_of(left_) != std::string_view(file_).substr(kMagic.size(), 64)) throw Damaged();
  }

  template <typename T>
  T get() {
    T value;
    take(&value, sizeof(T));
    return value;
  }
  template <typename T>
  std::vector<T> get_all() {
    const auto count = get<std::uint64_t>();
    if (count > kMostItems || count * sizeof(T) > left_.size()) throw Damaged();
    std::vector<T> values(static_cast<std::size_t>(count));
    if (count > 0) take(values.data(), values.size() * sizeof(T));
    return values;
  }
  std::string get_text() {
    const std::vector<char> text = get_all<char>();
    return {text.begin(), text.end()};
  }

 private:
  void take(void* to, std::size_t bytes) {
    if (bytes > left_.size()) throw Damaged();
    std::memcpy(to, left_.data(), bytes);
    left_.remove_prefix(bytes);
  }

  std::string file_;
  std::string_view left_;
};

}  // namespace

std::string cache_key(const std::string& text) { return sha256_of(text).substr(0, 32); }

std::string Cache::path_of(const std::string& key, const char* ending) const {
  return (fs::path(folder_) / (key + ending)).string();
}

std::optional<Features> Cache::features(const std::string& key) const {
  if (folder_.empty()) return std::nullopt;
  try {
    Reader reader(path_of(key, ".features"));
    Features features;
    features.points = reader.get_all<cv::Point2f>();
    features.sizes = reader.get_all<float>();
    features.colors = reader.get_all<cv::Vec3b>();
    const auto rows = reader.get<std::int32_t>();
    const auto columns = reader.get<std::int32_t>();
    const std::vector<std::uint8_t> bytes = reader.get_all<std::uint8_t>();
    const std::size_t count = features.points.size();
    if (features.sizes.size() != count || features.colors.size() != count ||
        rows != static_cast<std::int32_t>(count) || columns < 0 || columns > 4096 ||
        bytes.size() != count * static_cast<std::size_t>(columns)) {
      return std::nullopt;
    }
    if (count > 0)
      features.descriptors =
          cv::Mat(rows, columns, CV_8UC1, const_cast<std::uint8_t*>(bytes.data())).clone();
    return features;
  } catch (const Damaged&) {
  } catch (const InputError&) {
  }
  return std::nullopt;
}

void Cache::store(const std::string& key, const Features& features) const {
  if (folder_.empty()) return;
  Writer writer;
  writer.put(features.points);
  writer.put(features.sizes);
  writer.put(features.colors);
  writer.put(static_cast<std::int32_t>(features.points.size()));
  writer.put(static_cast<std::int32_t>(features.descriptors.cols));
  std::vector<std::uint8_t> bytes;
  for (int r = 0; r < features.descriptors.rows; ++r) {
    const std::uint8_t* row = features.descriptors.ptr(r);
    bytes.insert(bytes.end(), row, row + features.descriptors.cols);
  }
  writer.put(bytes);
  writer.write(path_of(key, ".features"));
}

Cache::Pairs Cache::pairs(const std::string& key) const {
  if (folder_.empty()) return {};
  try {
    Reader reader(path_of(key, ".pairs"));
    Pairs pairs;
    const auto count = reader.get<std::uint64_t>();
    for (std::uint64_t k = 0; k < count; ++k) {
      const std::string other = reader.get_text();
      PairEntry& entry = pairs[other];
      entry.matches = reader.get<std::int32_t>();
      entry.view.inliers = reader.get_all<Match>();
      entry.view.homography_inliers = reader.get<std::int32_t>();
      entry.view.second_from_first.rotation = reader.get<cv::Matx33d>();
      entry.view.second_from_first.translation = reader.get<cv::Vec3d>();
      entry.view.in_front = reader.get<std::int32_t>();
      entry.view.median_angle = reader.get<double>();
    }
    return pairs;
  } catch (const Damaged&) {
  } catch (const InputError&) {
  }
  return {};
}

void Cache::store(const std::string& key, const Pairs& pairs) const {
  if (folder_.empty()) return;
  Writer writer;
  writer.put(static_cast<std::uint64_t>(pairs.size()));
  for (const auto& [other, entry] : pairs) {
    writer.put(other);
    writer.put(static_cast<std::int32_t>(entry.matches));
    writer.put(entry.view.inliers);
    writer.put(static_cast<std::int32_t>(entry.view.homography_inliers));
    writer.put(entry.view.second_from_first.rotation);
    writer.put(entry.view.second_from_first.translation);
    writer.put(static_cast<std::int32_t>(entry.view.in_front));
    writer.put(entry.view.median_angle);
  }
  writer.write(path_of(key, ".pairs"));
}

}  // namespace tarsier::sfm
