// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/colmap_database.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/geometry/colmap_camera.h"
#include "tarsier/geometry/epipolar.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/sqlite.h"
#include "tarsier/sfm/scene/colmap.h"

#include <Eigen/LU>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <set>

namespace tarsier::sfm {
namespace {

using geometry::kColmapOffset;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr std::int64_t kPairBase = 2147483647;
constexpr std::int64_t kMaxFeatures = 10'000'000;  // per image
constexpr int kCalibrated = 2;                     // COLMAP's codes for kinds of pairs
constexpr int kUncalibrated = 3;
constexpr int kDescriptorBytes = 128;
constexpr int kSiftDescriptors = 0;  // COLMAP's code in the column `type` of descriptors
constexpr double kMaxPixel = 1e7;
// Of pose priors: COLMAP's codes for coordinate systems and sensors.
constexpr int kUndefinedSystem = -1;
constexpr int kWgs84 = 0;
constexpr int kCartesian = 1;
constexpr int kCameraSensor = 0;
constexpr double kMaxAltitude = 1e5;    // m
constexpr double kMaxCartesian = 1e12;  // in any unit

const char* const kTables =
    "CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT "
    "NULL, width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length "
    "INTEGER "
    "NOT NULL);"
    "CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL "
    "UNIQUE, camera_id INTEGER NOT NULL, prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz "
    "REAL, prior_tx REAL, prior_ty REAL, prior_tz REAL, CONSTRAINT image_id_check CHECK(image_id "
    ">= "
    "0 and image_id < 2147483647), FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));"
    "CREATE UNIQUE INDEX index_name ON images(name);"
    "CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols "
    "INTEGER NOT NULL, data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE "
    "CASCADE);"
    "CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols "
    "INTEGER NOT NULL, data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE "
    "CASCADE);"
    "CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols "
    "INTEGER NOT NULL, data BLOB);"
    "CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT "
    "NULL, "
    "cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, "
    "tvec BLOB);";

DatabaseKind colmap_kind() {
  DatabaseKind kind;
  kind.name = "COLMAP database";
  kind.application_id = 0;
  kind.versions = {kTables};
  kind.of_another_program = true;
  return kind;
}

template <typename Number>
std::span<const std::uint8_t> bytes_of(const std::vector<Number>& numbers) {
  return {reinterpret_cast<const std::uint8_t*>(numbers.data()), numbers.size() * sizeof(Number)};
}
std::span<const std::uint8_t> bytes_of(const double* numbers, std::size_t count) {
  return {reinterpret_cast<const std::uint8_t*>(numbers), count * sizeof(double)};
}

void check(const ColmapDatabase& database) {
  std::set<std::string> names;
  for (const auto& image : database.images) {
    TARSIER_REQUIRE(image.camera >= 0 && at(image.camera) < database.cameras.size(),
                    "camera {} of '{}'", image.camera, image.name);
    TARSIER_REQUIRE(names.insert(image.name).second, "the image name '{}' occurs twice",
                    image.name);
    const Features& features = image.features;
    TARSIER_REQUIRE(
        features.descriptors.empty() ||
            (features.descriptors.type() == CV_8UC1 &&
             features.descriptors.cols == kDescriptorBytes &&
             at(features.descriptors.rows) == features.points.size() + features.owners.size()),
        "the descriptors of '{}' are not SIFT descriptors, or their number is wrong", image.name);
  }
  for (const auto& pair : database.pairs) {
    TARSIER_REQUIRE(
        pair.first >= 0 && pair.first < pair.second && at(pair.second) < database.images.size(),
        "images {} and {}", pair.first, pair.second);
    for (const Match& match : pair.matches)
      TARSIER_REQUIRE(
          match.first >= 0 && match.second >= 0 &&
              at(match.first) < database.images[at(pair.first)].features.points.size() &&
              at(match.second) < database.images[at(pair.second)].features.points.size(),
          "a match of features {} and {}, which do not both exist", match.first, match.second);
  }
}

void write_images(Database& file, const ColmapDatabase& database) {
  Statement add_camera(file, "INSERT INTO cameras VALUES (?, ?, ?, ?, ?, ?)");
  for (std::size_t c = 0; c < database.cameras.size(); ++c) {
    const auto& camera = database.cameras[c];
    const geometry::ColmapCameraNumbers numbers = geometry::numbers_of(camera.camera);
    add_camera.bind(1, static_cast<std::int64_t>(c + 1))
        .bind(2, std::int64_t{numbers.model})
        .bind(3, numbers.width)
        .bind(4, numbers.height)
        .bind(5, bytes_of(numbers.parameters))
        .bind(6, std::int64_t{camera.is_focal_known ? 1 : 0});
    add_camera.step();
    add_camera.reset();
  }
  Statement add_image(file, "INSERT INTO images (image_id, name, camera_id) VALUES (?, ?, ?)");
  Statement add_points(file, "INSERT INTO keypoints VALUES (?, ?, 4, ?)");
  Statement add_descriptors(file, "INSERT INTO descriptors VALUES (?, ?, ?, ?)");
  for (std::size_t i = 0; i < database.images.size(); ++i) {
    const auto& image = database.images[i];
    const auto id = static_cast<std::int64_t>(i + 1);
    add_image.bind(1, id).bind(2, image.name).bind(3, std::int64_t{image.camera} + 1);
    add_image.step();
    add_image.reset();
    const Features& features = image.features;
    std::vector<float> numbers;
    for (std::size_t f = 0; f < features.points.size(); ++f) {
      const float size = f < features.sizes.size() ? features.sizes[f] : 2;
      numbers.insert(numbers.end(),
                     {features.points[f].x + static_cast<float>(kColmapOffset),
                      features.points[f].y + static_cast<float>(kColmapOffset), size / 2, 0});
    }
    const auto rows = static_cast<std::int64_t>(features.points.size());
    add_points.bind(1, id).bind(2, rows).bind(3, bytes_of(numbers));
    add_points.step();
    add_points.reset();
    if (features.descriptors.empty() && rows > 0) continue;
    // In COLMAP, a keypoint has one descriptor.
    const cv::Mat own =
        rows > 0 ? features.descriptors.rowRange(0, static_cast<int>(rows)) : features.descriptors;
    const cv::Mat contiguous = own.isContinuous() ? own : own.clone();
    add_descriptors.bind(1, id)
        .bind(2, rows)
        .bind(3, std::int64_t{kDescriptorBytes})
        .bind(4, std::span<const std::uint8_t>(contiguous.data, contiguous.total()));
    add_descriptors.step();
    add_descriptors.reset();
  }
}

void write_pairs(Database& file, const ColmapDatabase& database) {
  Statement add_matches(file, "INSERT INTO matches VALUES (?, ?, 2, ?)");
  Statement add_geometry(
      file, "INSERT INTO two_view_geometries VALUES (?, ?, 2, ?, ?, ?, ?, NULL, ?, ?)");
  for (const auto& pair : database.pairs) {
    const std::int64_t id = kPairBase * (pair.first + 1) + pair.second + 1;
    std::vector<std::uint32_t> numbers;
    for (const Match& match : pair.matches)
      numbers.insert(numbers.end(), {static_cast<std::uint32_t>(match.first),
                                     static_cast<std::uint32_t>(match.second)});
    const auto rows = static_cast<std::int64_t>(pair.matches.size());
    add_matches.bind(1, id).bind(2, rows).bind(3, bytes_of(numbers));
    add_matches.step();
    add_matches.reset();
    const auto& first = database.cameras[at(database.images[at(pair.first)].camera)];
    const auto& second = database.cameras[at(database.images[at(pair.second)].camera)];
    const bool is_calibrated = first.is_focal_known && second.is_focal_known;
    add_geometry.bind(1, id).bind(2, rows).bind(3, bytes_of(numbers));
    add_geometry.bind(4, std::int64_t{is_calibrated ? kCalibrated : kUncalibrated});
    const geometry::Rigid3& motion = pair.view.second_from_first;
    if (motion.translation.norm() > 0) {
      const RowMajor3 essential = geometry::essential_of(motion);
      // In COLMAP's pixels.
      const auto inverse_of = [](const geometry::Camera& c) {
        Eigen::Matrix3d k;
        k << c.fx, 0, c.cx + kColmapOffset, 0, c.fy, c.cy + kColmapOffset, 0, 0, 1;
        return Eigen::Matrix3d(k.inverse());
      };
      const RowMajor3 fundamental =
          inverse_of(second.camera).transpose() * essential * inverse_of(first.camera);
      const Eigen::Vector4d q = geometry::quaternion_of(motion.rotation);
      add_geometry.bind(5, bytes_of(fundamental.data(), 9)).bind(6, bytes_of(essential.data(), 9));
      add_geometry.bind(7, bytes_of(q.data(), 4)).bind(8, bytes_of(motion.translation.data(), 3));
    } else {
      for (int k = 5; k <= 8; ++k) add_geometry.bind_null(k);
    }
    add_geometry.step();
    add_geometry.reset();
  }
}

class Reader {
 public:
  explicit Reader(const std::string& path)
      : path_(path), file_(path, colmap_kind(), DatabaseAccess::kRead) {}

  ColmapDatabase read() {
    read_cameras();
    read_images();
    read_features();
    read_descriptors();
    read_pairs("two_view_geometries");
    if (result_.pairs.empty()) read_pairs("matches");
    std::sort(result_.pairs.begin(), result_.pairs.end(), [](const auto& a, const auto& b) {
      return std::pair(a.first, a.second) < std::pair(b.first, b.second);
    });
    return std::move(result_);
  }

  std::vector<ColmapPosePrior> read_pose_priors() {
    std::vector<ColmapPosePrior> priors;
    if (!has_column("pose_priors", "position")) return priors;
    read_cameras();
    read_images();
    const bool is_version4 = has_column("pose_priors", "corr_data_id");
    Statement row(file_,
                  fmt::format("SELECT {}, position, coordinate_system, {} FROM pose_priors",
                              is_version4 ? "corr_data_id" : "image_id",
                              is_version4 ? "corr_sensor_type" : std::to_string(kCameraSensor)));
    int undefined = 0;
    int unknown = 0;
    int impossible = 0;
    while (row.step()) {
      if (row.integer(3) != kCameraSensor) continue;
      const auto image = images_.find(row.integer(0));
      if (image == images_.end())
        fail(fmt::format("pose prior of image {}, which is not in the table images",
                         row.integer(0)));
      auto position = position_of(row.bytes(1), image->first);
      if (!position) continue;
      const std::int64_t system = row.integer(2);
      if (system == kWgs84) {
        if (std::isnan((*position)[2])) (*position)[2] = 0;
        if ((*position)[0] == 0 && (*position)[1] == 0) continue;
        if (!is_place(*position)) {
          ++impossible;
          continue;
        }
      } else if (system == kCartesian || system == kUndefinedSystem) {
        if (!(position->cwiseAbs().maxCoeff() <= kMaxCartesian) || position->hasNaN()) {
          ++impossible;
          continue;
        }
        if (system == kUndefinedSystem) ++undefined;
      } else {
        ++unknown;
        continue;
      }
      priors.push_back({result_.images[at(image->second)].name, system == kWgs84, *position});
    }
    if (undefined > 0)
      log_warning("{}: {} pose priors have no coordinate system: used as cartesian", path_,
                  undefined);
    if (unknown > 0)
      log_warning("{}: {} pose priors have an unknown coordinate system (left out)", path_,
                  unknown);
    if (impossible > 0)
      log_warning("{}: {} pose priors have an impossible position (left out)", path_, impossible);
    std::stable_sort(priors.begin(), priors.end(),
                     [](const auto& a, const auto& b) { return a.name < b.name; });
    return priors;
  }

 private:
  [[noreturn]] void fail(const std::string& reason) const { throw InputError(path_, reason); }

  // Nothing where there is no position: NULL, or all NaN.
  [[nodiscard]] std::optional<Eigen::Vector3d> position_of(const std::vector<std::uint8_t>& bytes,
                                                           std::int64_t id) const {
    Eigen::Vector3d position;
    if (bytes.empty()) return std::nullopt;
    if (bytes.size() != 3 * sizeof(double))
      fail(fmt::format("pose prior of image {}: {} bytes for 3 numbers", id, bytes.size()));
    std::memcpy(position.data(), bytes.data(), bytes.size());
    if (position.array().isNaN().all()) return std::nullopt;
    return position;
  }

  static bool is_place(const Eigen::Vector3d& wgs84) {
    return std::abs(wgs84[0]) <= 90 && std::abs(wgs84[1]) <= 360 &&
           std::abs(wgs84[2]) <= kMaxAltitude;
  }

  bool has_column(const std::string& table, const std::string& column) {
    Statement row(file_,
                  "SELECT 1 FROM pragma_table_info('" + table + "') WHERE name = '" + column + "'");
    return row.step();
  }

  // The numbers of a blob of rows x columns.
  template <typename Number>
  std::vector<Number> numbers(Statement& row, int rows_column, int data_column,
                              std::int64_t columns, const std::string& what) const {
    const std::int64_t rows = row.integer(rows_column);
    const std::vector<std::uint8_t> bytes = row.bytes(data_column);
    if (rows < 0 || rows > kMaxFeatures || columns < 0 || columns > 4096 ||
        bytes.size() != static_cast<std::size_t>(rows * columns) * sizeof(Number))
      fail(fmt::format("{}: {} bytes for {} x {} numbers", what, bytes.size(), rows, columns));
    std::vector<Number> result(static_cast<std::size_t>(rows * columns));
    if (!bytes.empty()) std::memcpy(result.data(), bytes.data(), bytes.size());
    return result;
  }

  void read_cameras() {
    Statement row(file_,
                  "SELECT camera_id, model, width, height, params, prior_focal_length FROM cameras "
                  "ORDER BY camera_id");
    while (row.step()) {
      const std::int64_t id = row.integer(0);
      geometry::ColmapCameraNumbers found;
      found.model = static_cast<int>(std::clamp<std::int64_t>(row.integer(1), -1, 1000));
      found.width = row.integer(2);
      found.height = row.integer(3);
      const std::vector<std::uint8_t> bytes = row.bytes(4);
      if (bytes.size() % sizeof(double) != 0 || bytes.size() > 1000)
        fail(fmt::format("camera {}: {} bytes of parameters", id, bytes.size()));
      found.parameters.resize(bytes.size() / sizeof(double));
      if (!bytes.empty()) std::memcpy(found.parameters.data(), bytes.data(), bytes.size());
      cameras_[id] = static_cast<int>(result_.cameras.size());
      result_.cameras.push_back({geometry::camera_of(found, path_, id), row.integer(5) != 0});
    }
  }

  void read_images() {
    Statement row(file_, "SELECT image_id, name, camera_id FROM images ORDER BY name");
    while (row.step()) {
      const std::int64_t id = row.integer(0);
      ColmapDatabase::DatabaseImage image;
      image.name = row.text(1);
      if (const std::string name_error = image_name_error(image.name); !name_error.empty())
        fail(fmt::format("image {}: {}", id, name_error));
      const auto camera = cameras_.find(row.integer(2));
      if (camera == cameras_.end()) fail(fmt::format("the camera of image {} is unknown", id));
      image.camera = camera->second;
      if (!images_.emplace(id, static_cast<int>(result_.images.size())).second)
        fail(fmt::format("image {} occurs twice", id));
      result_.images.push_back(std::move(image));
    }
  }

  void read_features() {
    Statement row(file_, "SELECT image_id, rows, cols, data FROM keypoints ORDER BY image_id");
    while (row.step()) {
      const auto image = images_.find(row.integer(0));
      if (image == images_.end())
        fail(
            fmt::format("keypoints of image {}, which is not in the table images", row.integer(0)));
      const std::string what = fmt::format("keypoints of image {}", image->first);
      const std::int64_t columns = row.integer(2);
      if (columns != 2 && columns != 4 && columns != 6)
        fail(fmt::format("{}: {} columns, expected 2, 4 or 6", what, columns));
      const std::vector<float> values = numbers<float>(row, 1, 3, columns, what);
      Features& features = result_.images[at(image->second)].features;
      for (std::size_t k = 0; k + 1 < values.size(); k += static_cast<std::size_t>(columns)) {
        const cv::Point2f p(values[k] - static_cast<float>(kColmapOffset),
                            values[k + 1] - static_cast<float>(kColmapOffset));
        if (!(std::abs(p.x) < static_cast<float>(kMaxPixel)) ||
            !(std::abs(p.y) < static_cast<float>(kMaxPixel)))
          fail(what + ": a position is far outside the image");
        float sigma = columns == 4 ? values[k + 2] : 1;
        if (columns == 6)  // an affine shape: use the mean length of its columns
          sigma = (std::hypot(values[k + 2], values[k + 4]) +
                   std::hypot(values[k + 3], values[k + 5])) /
                  2;
        if (!(sigma > 0 && sigma < 1e6F)) fail(what + ": a size is not above 0");
        features.points.push_back(p);
        features.sizes.push_back(2 * sigma);
      }
    }
  }

  void read_descriptors() {
    // COLMAP 4 added the kind of descriptors.
    const std::string type =
        has_column("descriptors", "type") ? "type" : std::to_string(kSiftDescriptors);
    Statement row(file_, "SELECT image_id, rows, cols, data, " + type +
                             " FROM descriptors ORDER BY image_id");
    int others = 0;
    while (row.step()) {
      const auto image = images_.find(row.integer(0));
      if (image == images_.end())
        fail(fmt::format("descriptors of image {}, which is not in the table images",
                         row.integer(0)));
      if (row.integer(4) != kSiftDescriptors) {
        ++others;
        continue;
      }
      const std::string what = fmt::format("descriptors of image {}", image->first);
      Features& features = result_.images[at(image->second)].features;
      if (row.integer(1) != static_cast<std::int64_t>(features.points.size()))
        fail(fmt::format("{}: {} descriptors for {} features", what, row.integer(1),
                         features.points.size()));
      if (features.points.empty()) continue;
      if (row.integer(2) != kDescriptorBytes)
        fail(fmt::format("{}: {} columns, expected {}", what, row.integer(2), kDescriptorBytes));
      const auto values = numbers<std::uint8_t>(row, 1, 3, kDescriptorBytes, what);
      features.descriptors = cv::Mat(static_cast<int>(features.points.size()), kDescriptorBytes,
                                     CV_8UC1, const_cast<std::uint8_t*>(values.data()))
                                 .clone();
    }
    if (others > 0)
      log_warning(
          "{}: the descriptors of {} of {} images are not SIFT and are ignored: only their stored "
          "matches are used",
          path_, others, images_.size());
  }

  void read_pairs(const std::string& table) {
    Statement row(file_, "SELECT pair_id, rows, data FROM " + table + " WHERE rows > 0");
    while (row.step()) {
      const std::int64_t id = row.integer(0);
      const std::string what = fmt::format("pair {} of {}", id, table);
      const auto first = images_.find(id / kPairBase);
      const auto second = images_.find(id % kPairBase);
      if (id < 0 || first == images_.end() || second == images_.end() || first == second)
        fail(what + ": an image is unknown");
      const auto values = numbers<std::uint32_t>(row, 1, 2, 2, what);
      ColmapDatabase::DatabasePair pair;
      const bool swap = first->second > second->second;
      pair.first = std::min(first->second, second->second);
      pair.second = std::max(first->second, second->second);
      const std::size_t of_first = result_.images[at(pair.first)].features.points.size();
      const std::size_t of_second = result_.images[at(pair.second)].features.points.size();
      for (std::size_t k = 0; k + 1 < values.size(); k += 2) {
        const std::uint32_t a = values[swap ? k + 1 : k];
        const std::uint32_t b = values[swap ? k : k + 1];
        if (a >= of_first || b >= of_second)
          fail(what + ": a match refers to a feature that does not exist");
        pair.matches.push_back({static_cast<int>(a), static_cast<int>(b)});
      }
      result_.pairs.push_back(std::move(pair));
    }
  }

  std::string path_;
  Database file_;
  ColmapDatabase result_;
  std::map<std::int64_t, int> cameras_;
  std::map<std::int64_t, int> images_;
};

}  // namespace

void write_colmap_database(const std::string& path, const ColmapDatabase& database) {
  check(database);
  AtomicFile output(path);
  {
    Database file(output.path(), colmap_kind(), DatabaseAccess::kCreate);
    Transaction transaction(file);
    write_images(file, database);
    write_pairs(file, database);
    transaction.commit();
  }
  output.commit();
}

ColmapDatabase read_colmap_database(const std::string& path) { return Reader(path).read(); }

std::vector<ColmapPosePrior> read_colmap_pose_priors(const std::string& path) {
  return Reader(path).read_pose_priors();
}

}  // namespace tarsier::sfm
