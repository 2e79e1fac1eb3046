// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/placement.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/sqlite.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/pipelines/colmap_database.h"
#include "tarsier/sfm/pipelines/testing_colmap_database.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/testing_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <span>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

// Positions of the registered images of the synthetic model (0, 2, 3, 4), moved by a similarity.
Positions moved_positions(const Model& model, const geometry::Sim3& by) {
  Positions known;
  for (const Image& image : model.images)
    if (image.registered) known[image.name] = by * image.pose.center();
  return known;
}

geometry::Sim3 some_similarity() {
  geometry::Sim3 result;
  result.scale = 3.5;
  result.rotation = geometry::rotation_of(Eigen::Vector4d(1, 0.2, -0.3, 0.1));
  result.translation = {10, -4, 2};
  return result;
}

std::vector<Input> inputs_of(const Model& model) {
  std::vector<Input> inputs;
  for (const Image& image : model.images) inputs.push_back({image.name, "/nowhere/" + image.name});
  return inputs;
}

PlacementOptions by_positions() {
  PlacementOptions options;
  options.alignment = Alignment::kPositions;
  options.positions_file = "positions.csv";
  return options;
}

std::string error_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(Placement, AlignsCamerasToTheirPositions) {
  Model model = synthetic_model();
  const Positions known = moved_positions(model, some_similarity());
  const Eigen::Vector3d point = some_similarity() * model.points[7].position;
  const Placement placement = place(model, by_positions(), known, 1);
  ASSERT_TRUE(placement.aligned);
  EXPECT_EQ(placement.aligned->images, 4);
  EXPECT_NEAR(placement.aligned->scale, 3.5, 1e-9);
  EXPECT_LT(placement.aligned->mean_residual, 1e-9);
  EXPECT_FALSE(placement.scale);
  for (const auto& [name, position] : known) {
    for (const Image& image : model.images) {
      if (image.name != name) continue;
      EXPECT_LT((image.pose.center() - position).norm(), 1e-9);
    }
  }
  EXPECT_LT((model.points[7].position - point).norm(), 1e-9);
  const auto json = to_json(placement);
  EXPECT_EQ(json["aligned"]["images"], 4);
  EXPECT_FALSE(json.contains("scale"));
}

TEST(Placement, ScalesTheModelToAKnownDistance) {
  Model model = synthetic_model();
  PlacementOptions options;
  options.distance = KnownDistance{model.images[0].name, model.images[3].name, 12.5};
  const Placement placement = place(model, options, {}, 1);
  EXPECT_NEAR((model.images[0].pose.center() - model.images[3].pose.center()).norm(), 12.5, 1e-9);
  ASSERT_TRUE(placement.scale);
  EXPECT_EQ(to_json(placement)["scale"], *placement.scale);
}

TEST(Placement, MarkersGiveTheScaleAlsoOfAnAlignedModel) {
  const Model original = synthetic_model();
  PlacementOptions options;
  options.markers =
      KnownMarkers{0.05, [](const cv::Mat&) { return std::vector<DetectedMarker>(); }};
  MarkerScale measured;
  measured.scale = 0.25;
  const auto distance = [](const Model& model) {
    return (model.images[0].pose.center() - model.images[2].pose.center()).norm();
  };
  Model model = original;
  const Placement placement = place(model, options, {}, 1, measured);
  EXPECT_DOUBLE_EQ(placement.scale.value_or(0), 0.25);
  EXPECT_NEAR(distance(model), 0.25 * distance(original), 1e-9);
  EXPECT_EQ(to_json(placement)["markers"]["markers"], 0);

  // Positions give the place, markers give the scale.
  model = original;
  options.alignment = Alignment::kGps;
  (void)place(model, options, moved_positions(original, some_similarity()), 1, measured);
  EXPECT_NEAR(distance(model), 0.25 * distance(original), 1e-9);
  EXPECT_THROW((void)place(model, options, {}, 1), std::invalid_argument);  // no measurement
}

TEST(Placement, AKnownDistanceLeavesAnAlignedModelAtItsPositions) {
  Model model = synthetic_model();
  geometry::Sim3 far = some_similarity();
  far.translation = {500'000, 4'650'000, 100};  // as UTM
  const Positions known = moved_positions(model, far);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& [name, position] : known) mean += position / static_cast<double>(known.size());
  const double aligned_distance =
      (known.at(model.images[0].name) - known.at(model.images[3].name)).norm();
  PlacementOptions options = by_positions();
  options.distance =
      KnownDistance{model.images[0].name, model.images[3].name, 1.01 * aligned_distance};
  const Placement placement = place(model, options, known, 1);
  EXPECT_NEAR(placement.scale.value_or(0), 1.01, 1e-6);
  double residual = 0;
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    const Eigen::Vector3d expected = mean + 1.01 * (known.at(image.name) - mean);
    EXPECT_LT((image.pose.center() - expected).norm(), 1e-5);
    residual += (image.pose.center() - known.at(image.name)).norm() / 4;
  }
  ASSERT_TRUE(placement.aligned);
  EXPECT_NEAR(placement.aligned->mean_residual, residual, 1e-9) << "of the scaled model";
}

TEST(Placement, WithoutOptionsLeavesTheModel) {
  const Model before = synthetic_model();
  Model model = before;
  PlacementOptions options;
  options.distance = KnownDistance{model.images[0].name, model.images[1].name, 2};
  EXPECT_NE(error_of([&] { (void)place(model, options, {}, 1); }).find("is not in the model"),
            std::string::npos);
  options.distance->second = "elsewhere.jpg";
  EXPECT_NE(error_of([&] { (void)place(model, options, {}, 1); }).find("'elsewhere.jpg'"),
            std::string::npos);
  Positions two = moved_positions(model, {});
  two.erase(model.images[0].name);
  two.erase(model.images[2].name);
  EXPECT_EQ(error_of([&] { (void)place(model, by_positions(), two, 1); }),
            "positions.csv: 2 positions belong to images of the model; three that are not "
            "collinear are needed; the model is written without alignment");
  EXPECT_EQ(model.images[0].pose.center(), before.images[0].pose.center());
  EXPECT_EQ(model.points[0].position, before.points[0].position);
}

TEST(Placement, PositionsAreCheckedBeforeTheReconstruction) {
  const Model model = synthetic_model();
  const auto inputs = inputs_of(model);
  Positions known = moved_positions(model, {});
  known["elsewhere.jpg"] = {1, 2, 3};
  const Positions used = positions_of(by_positions(), known, inputs, {});
  EXPECT_EQ(used.size(), 4U) << "of images that take part";
  EXPECT_TRUE(positions_of({}, known, inputs, {}).empty());

  const auto error = [&](const PlacementOptions& options, const Positions& given) {
    return error_of([&] { (void)positions_of(options, given, inputs, {}); });
  };
  EXPECT_EQ(
      error(by_positions(), {{inputs[0].name, {1, 2, 3}}, {"x", {0, 0, 0}}}),
      "positions.csv: 1 of 2 names belong to images (the first image is 'folder/photo 0.jpg'); "
      "three that are not collinear are needed");
  Positions line;
  for (std::size_t i = 0; i < 4; ++i)
    line[inputs[i].name] = Eigen::Vector3d::Constant(static_cast<double>(i));
  EXPECT_NE(error(by_positions(), line).find("the 4 positions of images are collinear"),
            std::string::npos);
  PlacementOptions gps;
  gps.alignment = Alignment::kGps;
  EXPECT_NE(error(gps, {}).find("0 of 5 images have a position in EXIF"), std::string::npos);
  PlacementOptions distance;
  distance.distance = KnownDistance{inputs[0].name, "nobody.jpg", 2};
  EXPECT_THROW((void)positions_of(distance, {}, inputs, {}), UsageError);
  EXPECT_NE(error(distance, {}).find("no image is named 'nobody.jpg'"), std::string::npos);
}

TEST(Placement, OptionsAreChecked) {
  PlacementOptions options;
  EXPECT_NO_THROW(options.check());
  EXPECT_FALSE(options.any());
  options.alignment = Alignment::kPositions;
  EXPECT_TRUE(options.any());
  EXPECT_THROW(options.check(), std::invalid_argument);
  options = {};
  options.distance = KnownDistance{"a", "a", 1};
  EXPECT_THROW(options.check(), std::invalid_argument);
  options.distance = KnownDistance{"a", "b", 0};
  EXPECT_THROW(options.check(), std::invalid_argument);
  options.distance->distance = INFINITY;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

// The start of a JPEG file whose EXIF has latitude and longitude, in whole seconds.
std::string jpeg_with_gps(double latitude_deg, double longitude_deg) {
  std::string tiff;
  const auto put = [&](std::uint32_t value, int size) {
    for (int k = 0; k < size; ++k) tiff += static_cast<char>(value >> (8 * k) & 0xFF);
  };
  const auto field = [&](std::uint32_t tag, std::uint32_t type, std::uint32_t count,
                         std::uint32_t value) {
    put(tag, 2);
    put(type, 2);
    put(count, 4);
    put(value, 4);
  };
  tiff = "II";
  put(42, 2);
  put(8, 4);
  put(1, 2);  // the main directory: the offset of the GPS directory
  field(0x8825, 4, 1, 26);
  put(0, 4);
  put(4, 2);  // GPS: 26 + 2 + 4 * 12 + 4 = 80
  field(1, 2, 2, 'N');
  field(2, 5, 3, 80);
  field(3, 2, 2, 'E');
  field(4, 5, 3, 104);
  put(0, 4);
  for (const double degrees : {latitude_deg, longitude_deg}) {
    const auto seconds = static_cast<std::uint32_t>(std::lround(degrees * 3600));
    for (const std::uint32_t part : {seconds / 3600, seconds / 60 % 60, seconds % 60}) {
      put(part, 4);
      put(1, 4);
    }
  }
  const std::string exif = std::string("Exif\0\0", 6) + tiff;
  const std::size_t length = exif.size() + 2;
  return std::string("\xFF\xD8\xFF\xE1") + static_cast<char>(length >> 8) +
         static_cast<char>(length & 0xFF) + exif;
}

class Gps : public FolderTest {};

TEST_F(Gps, PositionsAreInMetres) {
  std::vector<Input> inputs;
  const double degrees[][2] = {{47, 8}, {47 + 1.0 / 60, 8}, {47, 8 + 1.0 / 60}};
  for (int i = 0; i < 3; ++i) {
    const std::string name = std::to_string(i) + ".jpg";
    write_file_atomically(path(name), jpeg_with_gps(degrees[i][0], degrees[i][1]));
    inputs.push_back({name, path(name)});
  }
  write_file_atomically(path("none.jpg"), "\xFF\xD8 no EXIF");
  inputs.push_back({"none.jpg", path("none.jpg")});
  inputs.push_back({"missing.jpg", path("missing.jpg")});
  const Positions found = gps_positions(inputs, {});
  ASSERT_EQ(found.size(), 3U);
  // A minute of latitude is a nautical mile; one of longitude is cos(47 degrees) of it.
  const Eigen::Vector3d north = found.at("1.jpg") - found.at("0.jpg");
  EXPECT_NEAR(north[1], 1852, 5);
  EXPECT_NEAR(north[0], 0, 1);
  EXPECT_NEAR((found.at("2.jpg") - found.at("0.jpg"))[0], 1267, 5);
  PlacementOptions options;
  options.alignment = Alignment::kGps;
  EXPECT_EQ(positions_of(options, {}, inputs, {}), found);
  // They guide the choice of pairs by appearance. Given positions have priority.
  PipelineOptions pipeline;
  pipeline.pairs = PairChoice::kRetrieval;
  EXPECT_EQ(with_camera_positions(inputs, {}, pipeline, {})[1].position, found.at("1.jpg"));
  EXPECT_FALSE(with_camera_positions(inputs, {}, pipeline, {})[3].position.has_value());
  const Eigen::Vector3d given(1, 2, 3);
  EXPECT_EQ(with_camera_positions(inputs, {{"none.jpg", given}}, pipeline, {})[3].position, given);
  pipeline.pairs = PairChoice::kExhaustive;
  EXPECT_FALSE(with_camera_positions(inputs, {}, pipeline, {})[1].position.has_value());
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)gps_positions(inputs, stop.get_token()), Interrupted);
}

// Writes a database with these pose priors, one for each image 0.jpg, 1.jpg ..
void write_priors(const std::string& path, const std::vector<Eigen::Vector3d>& positions,
                  int coordinate_system) {
  ColmapDatabase database;
  database.cameras = {{geometry::Camera{64, 48, 50, 50, 31.5, 23.5}, true}};
  for (std::size_t i = 0; i < positions.size(); ++i)
    database.images.push_back({std::to_string(i) + ".jpg", 0, {}});
  write_colmap_database(path, database);
  Database file(path, test_support::colmap_database_kind(), DatabaseAccess::kWrite);
  file.run(
      "CREATE TABLE pose_priors (image_id INTEGER PRIMARY KEY NOT NULL, position BLOB, "
      "coordinate_system INTEGER NOT NULL, position_covariance BLOB)");
  Statement row(file, "INSERT INTO pose_priors VALUES (?, ?, ?, NULL)");
  for (std::size_t i = 0; i < positions.size(); ++i) {
    row.bind(1, static_cast<std::int64_t>(i + 1))
        .bind(2, std::span(reinterpret_cast<const std::uint8_t*>(positions[i].data()),
                           3 * sizeof(double)))
        .bind(3, std::int64_t{coordinate_system});
    row.step();
    row.reset();
  }
}

TEST_F(Gps, PosePriorsOfADatabaseCompleteExif) {
  // 0.jpg has EXIF, which the database contradicts; 1.jpg has a file without EXIF.
  write_file_atomically(path("0.jpg"), jpeg_with_gps(47, 8));
  write_file_atomically(path("1.jpg"), "\xFF\xD8 no EXIF");
  const std::vector<Input> inputs{{"0.jpg", path("0.jpg")}, {"1.jpg", path("1.jpg")}};
  const std::vector<Eigen::Vector3d> degrees{{10, 10, 0}, {47 + 1.0 / 60, 8, 0}, {47, 9, 5}};
  write_priors(path("gps.db"), degrees, 0);
  const Positions found = gps_positions(inputs, {}, path("gps.db"));
  ASSERT_EQ(found.size(), 2U) << "of images that take part";
  EXPECT_NEAR((found.at("1.jpg") - found.at("0.jpg"))[1], 1852, 5);

  // Without image files, the database alone gives them.
  const std::vector<Input> names{{"0.jpg", ""}, {"1.jpg", ""}, {"2.jpg", ""}};
  EXPECT_TRUE(gps_positions(names, {}).empty());
  const Positions all = gps_positions(names, {}, path("gps.db"));
  ASSERT_EQ(all.size(), 3U);
  PlacementOptions options;
  options.alignment = Alignment::kGps;
  EXPECT_EQ(positions_of(options, {}, names, {}, path("gps.db")), all);
  EXPECT_NE(error_of([&] {
              (void)positions_of(options, {}, inputs, {}, path("gps.db"));
            }).find("2 of 2 images have a position in EXIF or in the database; three"),
            std::string::npos);
  EXPECT_THROW((void)gps_positions(names, {}, path("none.db")), InputError);
}

TEST_F(Gps, CartesianPosePriorsAreUsedAsTheyAre) {
  const std::vector<Eigen::Vector3d> metres{{5e5, 5e6, 3}, {5e5 + 1, 5e6, 3}, {5e5, 5e6 + 2, 3}};
  write_priors(path("cartesian.db"), metres, 1);
  const std::vector<Input> names{{"0.jpg", ""}, {"1.jpg", ""}, {"2.jpg", ""}};
  const Positions all = gps_positions(names, {}, path("cartesian.db"));
  ASSERT_EQ(all.size(), 3U);
  EXPECT_EQ(all.at("2.jpg"), metres[2]);
  // They cannot be mixed with GPS.
  write_file_atomically(path("0.jpg"), jpeg_with_gps(47, 8));
  const Positions mixed =
      gps_positions({{"0.jpg", path("0.jpg")}, {"1.jpg", ""}}, {}, path("cartesian.db"));
  EXPECT_EQ(mixed.size(), 1U);
  EXPECT_TRUE(mixed.contains("0.jpg"));
}

}  // namespace
}  // namespace tarsier::sfm
