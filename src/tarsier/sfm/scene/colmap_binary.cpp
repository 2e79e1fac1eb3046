// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/colmap_binary.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/geometry/colmap_camera.h"
#include "tarsier/sfm/scene/buffered_file.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/colmap_limits.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <system_error>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;
using geometry::kColmapOffset;
static_assert(std::endian::native == std::endian::little);

constexpr std::uint64_t kMaxPoints = std::numeric_limits<int>::max();
constexpr std::size_t kMaxNameBytes = 4096;
constexpr std::uint64_t kNoPoint = std::numeric_limits<std::uint64_t>::max();

class BinaryWriter : public BufferedFile {
 public:
  using BufferedFile::BufferedFile;
  template <typename Number>
  void add(Number number) {
    const auto* bytes = reinterpret_cast<const char*>(&number);
    buffer().append(bytes, sizeof number);
    flush_if_full();
  }
  void add_text(const std::string& text) { buffer().append(text.c_str(), text.size() + 1); }
};

class BinaryReader {
 public:
  explicit BinaryReader(const std::string& path) : path_(path) {
    std::error_code error;
    const fs::file_status status = fs::status(path, error);
    if (!fs::exists(status)) throw InputError(path, "no such file");
    if (!fs::is_regular_file(status)) throw InputError(path, "is not a regular file");
    left_ = fs::file_size(path, error);
    stream_.open(path, std::ios::binary);
    if (error || !stream_) throw InputError(path, "cannot read");
  }
  template <typename Number>
  Number next() {
    Number number;
    take(&number, sizeof number);
    return number;
  }
  double number(const std::string& what) {
    const auto value = next<double>();
    if (!std::isfinite(value)) fail(what + " is not finite");
    return value;
  }
  // Reads the number of following items, of at least `bytes` each. It must fit into the file.
  std::uint64_t count(std::uint64_t max_count, std::uint64_t bytes, const std::string& what) {
    const auto value = next<std::uint64_t>();
    if (value > max_count || value > left_ / bytes)
      fail(fmt::format("{} {}: the file is truncated, or has another format", value, what));
    return value;
  }
  std::string text() {
    std::string result;
    for (char c = next<char>(); c != '\0'; c = next<char>()) {
      if (result.size() == kMaxNameBytes) fail("a name is too long");
      result += c;
    }
    return result;
  }
  void expect_end() const {
    if (left_ > 0) fail(fmt::format("{} bytes follow the last record", left_));
  }
  [[noreturn]] void fail(const std::string& reason) const { throw InputError(path_, reason); }
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  void take(void* to, std::size_t bytes) {
    if (left_ < bytes || !stream_.read(static_cast<char*>(to), static_cast<std::streamsize>(bytes)))
      fail("is truncated");
    left_ -= bytes;
  }
  std::string path_;
  std::ifstream stream_;
  std::uint64_t left_ = 0;
};

class BinaryModel {
 public:
  Model read(const fs::path& folder) {
    read_cameras((folder / "cameras.bin").string());
    const std::string images = (folder / "images.bin").string();
    read_images(images);
    read_points((folder / "points3D.bin").string());
    for (std::size_t i = 0; i < point_ids_.size(); ++i)
      for (std::size_t f = 0; f < point_ids_[i].size(); ++f)
        if (point_ids_[i][f] != kNoPoint)
          throw InputError(images,
                           fmt::format("feature {} of '{}' belongs to point {}, but the track of "
                                       "the point does not contain the feature",
                                       f, printable(model_.images[i].name), point_ids_[i][f]));
    return std::move(model_);
  }

 private:
  void read_cameras(const std::string& path) {
    BinaryReader reader(path);
    const auto count = reader.count(kMaxColmapItems, 24, "cameras");
    for (std::uint64_t k = 0; k < count; ++k) {
      const auto id = reader.next<std::uint32_t>();
      geometry::ColmapCameraNumbers numbers;
      numbers.model = reader.next<std::int32_t>();
      numbers.width = static_cast<std::int64_t>(reader.next<std::uint64_t>());
      numbers.height = static_cast<std::int64_t>(reader.next<std::uint64_t>());
      const int parameters = geometry::colmap_parameter_count(numbers.model);
      for (int p = 0; p < parameters; ++p)
        numbers.parameters.push_back(reader.number(fmt::format("a parameter of camera {}", id)));
      if (!cameras_.emplace(id, static_cast<int>(k)).second)
        reader.fail(fmt::format("camera {} occurs twice", id));
      model_.cameras.push_back(geometry::camera_of(numbers, path, id));
    }
    reader.expect_end();
  }

  void read_images(const std::string& path) {
    BinaryReader reader(path);
    std::set<std::string> names;
    const auto count = reader.count(kMaxColmapItems, 73, "images");
    std::uint64_t features = 0;
    for (std::uint64_t k = 0; k < count; ++k) {
      const auto id = reader.next<std::uint32_t>();
      const std::string what = fmt::format("image {}", id);
      Image image;
      image.registered = true;
      Eigen::Vector4d q;
      for (int i = 0; i < 4; ++i) q[i] = reader.number("the rotation of " + what);
      if (!(q.norm() > 0.9 && q.norm() < 1.1))
        reader.fail(fmt::format("the quaternion of {} has length {}, not 1", what, q.norm()));
      image.pose.rotation = geometry::rotation_of(q);
      for (int i = 0; i < 3; ++i)
        image.pose.translation[i] = reader.number("the translation of " + what);
      const auto camera = cameras_.find(reader.next<std::uint32_t>());
      if (camera == cameras_.end()) reader.fail("the camera of " + what + " is unknown");
      image.camera = camera->second;
      image.name = reader.text();
      if (const std::string error = image_name_error(image.name); !error.empty())
        reader.fail(what + ": " + error);
      if (!names.insert(image.name).second)
        reader.fail(fmt::format("'{}' occurs twice", printable(image.name)));
      if (!images_.emplace(id, static_cast<int>(k)).second) reader.fail(what + " occurs twice");
      const auto own = reader.count(kMaxColmapFeatures - features, 24, "features of " + what);
      features += own;
      std::vector<std::uint64_t>& ids = point_ids_.emplace_back();
      for (std::uint64_t f = 0; f < own; ++f) {
        const double x = reader.number("a feature of " + what) - kColmapOffset;
        const double y = reader.number("a feature of " + what) - kColmapOffset;
        if (std::abs(x) > kMaxColmapPixel || std::abs(y) > kMaxColmapPixel)
          reader.fail(
              fmt::format("the feature ({}, {}) of {} is far outside the image", x, y, what));
        image.features.emplace_back(static_cast<float>(x), static_cast<float>(y));
        ids.push_back(reader.next<std::uint64_t>());
      }
      image.points.assign(image.features.size(), -1);
      model_.images.push_back(std::move(image));
    }
    reader.expect_end();
  }

  void read_points(const std::string& path) {
    BinaryReader reader(path);
    std::set<std::uint64_t> seen;
    const auto count = reader.count(kMaxPoints, 43, "points");
    for (std::uint64_t k = 0; k < count; ++k) {
      const auto id = reader.next<std::uint64_t>();
      const std::string what = fmt::format("point {}", id);
      if (id == kNoPoint || !seen.insert(id).second) reader.fail(what + " occurs twice");
      Point point;
      for (int i = 0; i < 3; ++i) point.position[i] = reader.number(what);
      for (int i = 2; i >= 0; --i) point.color[i] = reader.next<std::uint8_t>();
      point.error = std::max(reader.number("the error of " + what), 0.0);
      const auto length = reader.count(kMaxColmapFeatures, 8, "observations of " + what);
      std::set<int> observing_images;
      for (std::uint64_t t = 0; t < length; ++t) {
        const auto image = images_.find(reader.next<std::uint32_t>());
        const auto feature = reader.next<std::uint32_t>();
        if (image == images_.end()) reader.fail("an image of " + what + " is unknown");
        std::vector<std::uint64_t>& ids = point_ids_[static_cast<std::size_t>(image->second)];
        if (feature >= ids.size() || ids[feature] != id)
          reader.fail(fmt::format(
              "feature {} of '{}' does not belong to {} in images.bin, or occurs twice in its "
              "track",
              feature, printable(model_.images[static_cast<std::size_t>(image->second)].name),
              what));
        ids[feature] = kNoPoint;  // mark as used
        // Of two features of one image the first is kept.
        if (observing_images.insert(image->second).second)
          point.track.push_back({image->second, static_cast<int>(feature)});
      }
      if (point.track.size() < 2) continue;
      for (const auto& [i, f] : point.track)
        model_.images[static_cast<std::size_t>(i)].points[static_cast<std::size_t>(f)] =
            static_cast<int>(model_.points.size());
      model_.points.push_back(std::move(point));
    }
    reader.expect_end();
  }

  Model model_;
  // Trees, as a file with chosen ids could make hash tables slow.
  std::map<std::uint32_t, int> cameras_;
  std::map<std::uint32_t, int> images_;
  std::vector<std::vector<std::uint64_t>> point_ids_;  // per feature of each image
};

}  // namespace

void write_colmap_binary(const std::string& folder, const Model& model) {
  check_model(model);
  make_folder(folder);
  const fs::path directory = folder;
  // Ids from 1, for what the registered images need.
  std::vector<std::uint32_t> camera_ids(model.cameras.size(), 0);
  std::vector<std::uint32_t> image_ids(model.images.size(), 0);
  std::uint64_t images = 0;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    if (!model.images[i].registered) continue;
    image_ids[i] = static_cast<std::uint32_t>(++images);
    camera_ids[static_cast<std::size_t>(model.images[i].camera)] = 1;
    if (const std::string error = image_name_error(model.images[i].name); !error.empty())
      throw OutputError(folder, error);
  }
  std::uint64_t cameras = 0;
  for (std::uint32_t& id : camera_ids)
    if (id != 0) id = static_cast<std::uint32_t>(++cameras);

  BinaryWriter camera_file((directory / "cameras.bin").string());
  camera_file.add(cameras);
  for (std::size_t c = 0; c < model.cameras.size(); ++c) {
    if (camera_ids[c] == 0) continue;
    const geometry::ColmapCameraNumbers numbers = geometry::numbers_of(model.cameras[c]);
    camera_file.add(camera_ids[c]);
    camera_file.add(static_cast<std::int32_t>(numbers.model));
    camera_file.add(static_cast<std::uint64_t>(numbers.width));
    camera_file.add(static_cast<std::uint64_t>(numbers.height));
    for (const double value : numbers.parameters) camera_file.add(value);
  }

  BinaryWriter image_file((directory / "images.bin").string());
  image_file.add(images);
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const Image& image = model.images[i];
    if (!image.registered) continue;
    image_file.add(image_ids[i]);
    const Eigen::Vector4d q = geometry::quaternion_of(image.pose.rotation);
    for (int k = 0; k < 4; ++k) image_file.add(q[k]);
    for (int k = 0; k < 3; ++k) image_file.add(image.pose.translation[k]);
    image_file.add(camera_ids[static_cast<std::size_t>(image.camera)]);
    image_file.add_text(image.name);
    image_file.add(static_cast<std::uint64_t>(image.features.size()));
    for (std::size_t f = 0; f < image.features.size(); ++f) {
      image_file.add(static_cast<double>(image.features[f].x) + kColmapOffset);
      image_file.add(static_cast<double>(image.features[f].y) + kColmapOffset);
      image_file.add(image.points[f] < 0 ? kNoPoint
                                         : static_cast<std::uint64_t>(image.points[f]) + 1);
    }
  }

  BinaryWriter point_file((directory / "points3D.bin").string());
  point_file.add(static_cast<std::uint64_t>(model.points.size()));
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    const Point& point = model.points[p];
    point_file.add(static_cast<std::uint64_t>(p + 1));
    for (int k = 0; k < 3; ++k) point_file.add(point.position[k]);
    for (int k = 2; k >= 0; --k) point_file.add(static_cast<std::uint8_t>(point.color[k]));
    point_file.add(point.error);
    point_file.add(static_cast<std::uint64_t>(point.track.size()));
    for (const auto& [i, f] : point.track) {
      point_file.add(image_ids[static_cast<std::size_t>(i)]);
      point_file.add(static_cast<std::uint32_t>(f));
    }
  }
  BufferedFile::commit_all({&camera_file, &image_file, &point_file});
}

Model read_colmap_binary(const std::string& folder) { return BinaryModel().read(folder); }

bool is_colmap_binary(const std::string& folder) {
  std::error_code error;
  return fs::exists(fs::path(folder) / "cameras.bin", error) &&
         !fs::exists(fs::path(folder) / "cameras.txt", error);
}

}  // namespace tarsier::sfm
