// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/ply.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/testing_model.h"

#include <Eigen/Geometry>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

// A PLY reader that uses only the information of the header.
struct Property {
  std::string name;
  std::string type;
  bool is_list = false;
};
struct Element {
  std::string name;
  std::size_t count = 0;
  std::vector<Property> properties;
  std::vector<std::vector<double>> rows;
};

double read_number(const std::string& bytes, std::size_t& offset, const std::string& type) {
  const auto copy = [&]<typename T>(T value) {
    EXPECT_LE(offset + sizeof(T), bytes.size());
    if (offset + sizeof(T) <= bytes.size()) std::memcpy(&value, bytes.data() + offset, sizeof(T));
    offset += sizeof(T);
    return static_cast<double>(value);
  };
  if (type == "float") return copy(float{});
  if (type == "double") return copy(double{});
  if (type == "int") return copy(std::int32_t{});
  EXPECT_EQ(type, "uchar");
  return copy(std::uint8_t{});
}

std::vector<Element> read_ply(const std::string& bytes) {
  const std::string end = "end_header\n";
  std::size_t offset = bytes.find(end);
  EXPECT_NE(offset, std::string::npos);
  std::istringstream header(bytes.substr(0, offset));
  offset += end.size();
  std::vector<Element> elements;
  std::string line;
  std::getline(header, line);
  EXPECT_EQ(line, "ply");
  std::getline(header, line);
  EXPECT_EQ(line, "format binary_little_endian 1.0");
  while (std::getline(header, line)) {
    std::istringstream words(line);
    std::string word;
    words >> word;
    if (word == "element") {
      elements.emplace_back();
      words >> elements.back().name >> elements.back().count;
    } else if (word == "property") {
      Property property;
      words >> property.type;
      property.is_list = property.type == "list";
      if (property.is_list) words >> word >> property.type;
      words >> property.name;
      elements.back().properties.push_back(property);
    }
  }
  for (Element& element : elements) {
    for (std::size_t k = 0; k < element.count; ++k) {
      std::vector<double> row;
      for (const Property& property : element.properties) {
        const double count = property.is_list ? read_number(bytes, offset, "uchar") : 1;
        for (int i = 0; i < count; ++i) row.push_back(read_number(bytes, offset, property.type));
      }
      element.rows.push_back(row);
    }
  }
  EXPECT_EQ(offset, bytes.size());
  return elements;
}

class PlyTest : public FolderTest {
 protected:
  const Model model_ = synthetic_model();
};

TEST_F(PlyTest, PointsHavePositionsAndColors) {
  write_points_ply(path("points.ply"), model_);
  const std::vector<Element> elements = read_ply(contents(path("points.ply")));
  ASSERT_EQ(elements.size(), 1U);
  EXPECT_EQ(elements[0].name, "vertex");
  std::vector<std::string> names;
  for (const Property& property : elements[0].properties) names.push_back(property.name);
  EXPECT_THAT(names, ElementsAre("x", "y", "z", "red", "green", "blue"));
  ASSERT_EQ(elements[0].rows.size(), model_.points.size());
  for (std::size_t p = 0; p < model_.points.size(); ++p) {
    const Point& point = model_.points[p];
    const std::vector<double>& row = elements[0].rows[p];
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(row[static_cast<std::size_t>(k)], point.position[k], 1e-6);
      EXPECT_EQ(row[static_cast<std::size_t>(3 + k)], point.color[2 - k]);
    }
  }
}

TEST_F(PlyTest, FarFromTheOriginCoordinatesAreDouble) {
  Model far = model_;
  geometry::Sim3 utm;
  utm.translation = {500'123, 4'649'776, 120};
  transform(far, utm);
  far.points[0].position = {0, 0, 1e9};  // a wrong point does not count
  write_points_ply(path("points.ply"), far);
  write_cameras_ply(path("cameras.ply"), far, 0.25);
  const std::vector<Element> points = read_ply(contents(path("points.ply")));
  const std::vector<Element> cameras = read_ply(contents(path("cameras.ply")));
  EXPECT_EQ(points[0].properties[2].type, "double");
  ASSERT_EQ(points[0].rows.size(), far.points.size());
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(points[0].rows[7][k], far.points[7].position[static_cast<int>(k)]);
    EXPECT_EQ(cameras[0].rows[0][k], far.images[0].pose.center()[static_cast<int>(k)]);
  }
}

TEST_F(PlyTest, CamerasAreDrawnAsTheirViewingPyramids) {
  write_cameras_ply(path("cameras.ply"), model_, 0.25);
  const std::vector<Element> elements = read_ply(contents(path("cameras.ply")));
  ASSERT_EQ(elements.size(), 3U);
  std::vector<std::pair<std::string, std::size_t>> counts;
  for (const Element& element : elements) counts.emplace_back(element.name, element.count);
  EXPECT_THAT(counts, ElementsAre(Pair("vertex", 20U), Pair("face", 24U), Pair("edge", 32U)));

  std::vector<Eigen::Vector3d> vertices;
  for (const std::vector<double>& row : elements[0].rows)
    vertices.emplace_back(row[0], row[1], row[2]);
  std::size_t first = 0;
  for (const Image& image : model_.images) {
    if (!image.registered) continue;
    EXPECT_LT((vertices[first] - image.pose.center()).norm(), 1e-6);
    const geometry::Camera& camera = model_.cameras[static_cast<std::size_t>(image.camera)];
    geometry::Camera pinhole = camera;
    pinhole.distortion = {};
    const std::vector<cv::Point2d> corners{{-0.5, -0.5},
                                           {camera.width - 0.5, -0.5},
                                           {camera.width - 0.5, camera.height - 0.5},
                                           {-0.5, camera.height - 0.5}};
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d seen = image.pose * vertices[first + 1 + k];
      EXPECT_NEAR(seen[2], 0.25, 1e-6);
      EXPECT_LT(cv::norm(pinhole.project(seen).value() - corners[k]), 2e-3);
    }
    first += 5;
  }
  // The middle of the pyramid lies behind each of its faces.
  for (const std::vector<double>& row : elements[1].rows) {
    ASSERT_EQ(row.size(), 3U);
    std::vector<std::size_t> at;
    for (const double index : row) at.push_back(static_cast<std::size_t>(index));
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    for (std::size_t k = 0; k < 5; ++k) center += 0.2 * vertices[at[0] / 5 * 5 + k];
    const Eigen::Vector3d& a = vertices[at[0]];
    EXPECT_GT((vertices[at[1]] - a).cross(vertices[at[2]] - a).dot(a - center), 0);
  }
  for (const std::vector<double>& row : elements[2].rows)
    EXPECT_EQ(static_cast<int>(row[0]) / 5, static_cast<int>(row[1]) / 5);
}

TEST_F(PlyTest, AnEmptyModelIsAFileWithoutVertices) {
  write_points_ply(path("points.ply"), {});
  write_cameras_ply(path("cameras.ply"), {}, 1);
  EXPECT_EQ(read_ply(contents(path("points.ply")))[0].count, 0U);
  EXPECT_EQ(read_ply(contents(path("cameras.ply"))).size(), 3U);
}

TEST_F(PlyTest, InvalidNumbersAreRefused) {
  Model model = model_;
  model.points[3].position[0] = std::numeric_limits<double>::infinity();
  EXPECT_THROW(write_points_ply(path("points.ply"), model), std::invalid_argument);
  EXPECT_THROW(write_cameras_ply(path("cameras.ply"), model_, 0), std::invalid_argument);
  EXPECT_EQ(files(), 0U);
  EXPECT_THROW(write_points_ply(path("none/points.ply"), model_), OutputError);
}

}  // namespace
}  // namespace tarsier::sfm
