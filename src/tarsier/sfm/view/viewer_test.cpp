// SPDX-License-Identifier: MIT
#include "viewer.h"

#include "tarsier/core/base64.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>

namespace tarsier::sfm {
namespace {

using testing::HasSubstr;
using testing::Not;

Model sample_model(int points) {
  Model model;
  model.cameras.emplace_back();
  for (int i = 0; i < 3; ++i) {
    Image image;
    image.name = "photo" + std::to_string(i) + ".jpg";
    image.registered = i < 2;
    image.pose.translation = {0.5 * i, 0, 6};
    model.images.push_back(image);
  }
  for (int i = 0; i < points; ++i)
    model.points.push_back(
        {{std::sin(0.7 * i), std::cos(1.3 * i), std::sin(2.1 * i)}, {10, 20, 200}, 0.5, {}});
  return model;
}

nlohmann::json data_of(const std::string& page) {
  const std::string open = "class=\"tv-data\">";
  const std::size_t from = page.find(open);
  EXPECT_NE(from, std::string::npos);
  const std::size_t begin = from + open.size();
  return nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
}

std::string bytes_of(const std::string& base64) {
  const auto bytes = from_base64(base64);
  EXPECT_TRUE(bytes.has_value());
  return bytes ? std::string(bytes->begin(), bytes->end()) : std::string();
}

TEST(Viewer, IsOnePageThatNeedsNoNetwork) {
  const std::string page = viewer_html(sample_model(1500), "A house");
  EXPECT_EQ(page.find("<!doctype html>"), 0U);
  EXPECT_THAT(page, HasSubstr("<title>A house</title>"));
  EXPECT_THAT(page, HasSubstr("1,500 points"));
  EXPECT_THAT(page, HasSubstr("2 of 3 images"));
  EXPECT_THAT(page, Not(HasSubstr("http")));
  EXPECT_THAT(page, Not(HasSubstr("src=")));
  EXPECT_THAT(page, Not(HasSubstr("url(")));
  EXPECT_THAT(page, HasSubstr("photo1.jpg"));
  EXPECT_THAT(page, Not(HasSubstr("photo2.jpg")));  // not registered
}

// Two faces with four points as large as the cloud.
ViewerLayers sample_layers() {
  ViewerLayers layers;
  for (int i = 0; i < 10; ++i) {
    layers.cloud.positions.emplace_back(0.1F * static_cast<float>(i), 0, 0);
    layers.cloud.colors.emplace_back(1, 2, 3);
  }
  layers.surface.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1e6F, 0, 0}};
  layers.surface.colors.assign(4, {1, 2, 3});
  layers.surface.indices = {0, 1, 2, 0, 1, 3};
  return layers;
}

TEST(Viewer, LayersHaveButtonsAndTheUnitOfTheModel) {
  const Model model = sample_model(500);
  const std::string plain = viewer_html(model, "x");
  EXPECT_THAT(plain, Not(HasSubstr("data-layer")));
  EXPECT_THAT(plain, HasSubstr("tv-measure"));

  const std::string page = viewer_html(model, "x", sample_layers());
  for (const char* layer : {"points", "cloud", "mesh"})
    EXPECT_THAT(page, HasSubstr("data-layer=\"" + std::string(layer) + "\"")) << layer;
  EXPECT_THAT(page, HasSubstr("10 dense points"));
  EXPECT_THAT(page, HasSubstr("2 faces"));
  const nlohmann::json data = data_of(page);
  EXPECT_EQ(data["cloud"]["drawn"], 10);
  EXPECT_FALSE(data["mesh"].contains("texture"));
  // A face with a vertex far away is not drawn.
  EXPECT_EQ(bytes_of(data["mesh"]["indices"]).size(), 3 * sizeof(std::uint32_t));
  // Distances measured on the page are in units of the model.
  const std::string bytes = bytes_of(data["mesh"]["positions"]);
  std::array<float, 6> at{};
  std::memcpy(at.data(), bytes.data(), sizeof at);
  const double side = std::hypot(at[3] - at[0], at[4] - at[1], at[5] - at[2]);
  EXPECT_NEAR(side * data["unit"].get<double>(), 1, 1e-5);
}

TEST(Viewer, RefusesInconsistentLayers) {
  const Model model = sample_model(500);
  ViewerLayers layers = sample_layers();
  layers.surface.indices.back() = 4;
  EXPECT_THROW((void)viewer_html(model, "", layers), std::invalid_argument);
  layers = sample_layers();
  layers.surface.texture = "bytes";  // without texture coordinates
  EXPECT_THROW((void)viewer_html(model, "", layers), std::invalid_argument);
  layers = sample_layers();
  layers.cloud.colors.pop_back();
  EXPECT_THROW((void)viewer_html(model, "", layers), std::invalid_argument);
}

TEST(Viewer, HoldsThePoints) {
  const Model model = sample_model(1500);
  const nlohmann::json data = data_of(viewer_html(model, "", 1000));
  EXPECT_EQ(data["drawn"], 1000);
  EXPECT_EQ(bytes_of(data["positions"]).size(), 6000U);
  const std::string colors = bytes_of(data["colors"]);
  ASSERT_EQ(colors.size(), 3000U);
  EXPECT_EQ(colors.substr(0, 3), "\xc8\x14\x0a");  // red first
  EXPECT_EQ(bytes_of(data["cameras"]).size(), 2U * 15 * 4);
  EXPECT_THAT(viewer_html(model, "", 1000), HasSubstr("1,500 points, 1,000 drawn"));
  EXPECT_EQ(viewer_html(model, "x", 1000), viewer_html(model, "x", 1000));
}

TEST(Viewer, OutliersDoNotReduceThePrecision) {
  Model model = sample_model(2000);
  model.points.push_back({{1e6, 0, 0}, {}, 0, {}});
  model.points.push_back({{std::nan(""), 0, 0}, {}, 0, {}});
  const std::string page = viewer_html(model, "");
  EXPECT_LE(data_of(page)["range"].get<double>(), 8);
  EXPECT_THAT(page, HasSubstr("2,002 points, 2,000 drawn"));
}

TEST(Viewer, EscapesNamesAndTitle) {
  Model model = sample_model(20);
  model.images[0].name = "</script><img src=x onerror=alert(1)>\"'&.jpg";
  model.images[1].name = "\xff\xfe broken \xe2\x80\xa8.jpg";
  const std::string page = viewer_html(model, "<b onclick='x()'>\"&");
  EXPECT_THAT(page, Not(HasSubstr("<img")));
  EXPECT_THAT(page, Not(HasSubstr("<b onclick")));
  EXPECT_THAT(page, HasSubstr("&lt;b onclick=&#39;x()&#39;&gt;&quot;&amp;"));
  // The script reads exactly this name.
  EXPECT_EQ(data_of(page)["names"][0], model.images[0].name);
}

TEST(Viewer, EmptyModelGivesAPage) {
  const std::string page = viewer_html(Model{}, "Nothing");
  EXPECT_THAT(page, HasSubstr("0 points"));
  EXPECT_EQ(data_of(page)["drawn"], 0);
  EXPECT_THROW((void)viewer_html(Model{}, "", 0), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
