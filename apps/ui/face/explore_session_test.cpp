// SPDX-License-Identifier: MIT
#include "ui/face/explore_session.h"

#include "tarsier/core/progress.h"
#include "tarsier/face/appearance/testing_portraits.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "ui/testing_plain.h"
#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier {
namespace {

const face::appearance::AppearanceModel& model() {
  static const face::appearance::AppearanceModel result = [] {
    NoProgress silent;
    return face::appearance::train_appearance_model(
        face::appearance::test_support::portraits(30, 1), {}, {}, silent, {});
  }();
  return result;
}

double mean_difference(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() ? cv::norm(a, b, cv::NORM_L1) / static_cast<double>(a.total()) : 1e9;
}

TEST(ExploreSession, WithoutStatusEachModeHasASlider) {
  face::appearance::AppearanceOptions options;
  options.shape.variance = 0.999999;
  options.texture_variance = options.colour_variance = 0.999999;
  options.frame_width = options.colour_width = 32;
  options.levels = 1;
  NoProgress silent;
  const face::appearance::AppearanceModel many = face::appearance::train_appearance_model(
      face::appearance::test_support::portraits(30, 1), {}, options, silent, {});
  ExploreSession session(many, std::nullopt, 1);
  const View view = session.on_idle({});
  const std::size_t all = view.state.at("shape").size() + view.state.at("look").size();
  const std::size_t few = std::min<std::size_t>(4, view.state.at("shape").size()) +
                          std::min<std::size_t>(4, view.state.at("look").size());
  ASSERT_GT(all, few);
  EXPECT_EQ(session.sliders().size(), few);
  session.draw_status(false);
  ASSERT_EQ(session.sliders().size(), all);
  const cv::Mat mean = session.image();
  const Slider last = session.sliders().back();
  (void)session.on_event(slider_event(last.name, 3));
  EXPECT_EQ(session.sliders().back().value, 3);
  EXPECT_GT(mean_difference(session.image(), mean), 0) << last.name;
}

TEST(ExploreSession, SlidersChangeTheFace) {
  ExploreSession session(model(), std::nullopt, 1);
  const cv::Mat mean = session.image();
  for (const Slider& slider : session.sliders()) {
    const View view = session.on_event(slider_event(slider.name, 2.5));
    EXPECT_GT(mean_difference(session.image(), mean), 0.3) << slider.name;
    EXPECT_FALSE(view.image.empty());
    (void)session.on_event(slider_event(slider.name, 0));
    EXPECT_EQ(mean_difference(session.image(), mean), 0) << slider.name;
  }
}

TEST(ExploreSession, ClampsValuesToThreeDeviations) {
  ExploreSession session(model(), std::nullopt, 1);
  const View view = session.on_event(slider_event("shape 1", 50));
  EXPECT_EQ(view.state["shape"][0], 3);
  const nlohmann::json before = view.state;
  for (const char* name : {"shape 0", "shape 99", "nose 1", "shape", "look x"})
    EXPECT_EQ(session.on_event(slider_event(name, 1)).state, before) << name;
}

TEST(ExploreSession, KeysMoveModesWithoutASlider) {
  ExploreSession session(model(), std::nullopt, 1);
  const cv::Mat mean = session.image();
  EXPECT_EQ(session.on_idle({}).state["mode"], "shape 1");
  (void)session.on_event(key_event('p'));  // round to the last one
  const View view = session.on_event(key_event('+'));
  const auto last = view.state["look"].size() - 1;
  EXPECT_EQ(view.state["mode"], "look " + std::to_string(last + 1));
  EXPECT_EQ(view.state["look"][last], 0.25);
  (void)session.on_event(key_event('-'));
  EXPECT_EQ(mean_difference(session.image(), mean), 0);
  EXPECT_EQ(session.on_event(key_event('n')).state["mode"], "shape 1");
}

TEST(ExploreSession, SeedDeterminesRandomFaces) {
  ExploreSession first(model(), std::nullopt, 4);
  ExploreSession second(model(), std::nullopt, 4);
  (void)first.on_event(key_event('r'));
  (void)second.on_event(key_event('r'));
  EXPECT_EQ(mean_difference(first.image(), second.image()), 0);
  (void)second.on_event(key_event('r'));
  EXPECT_GT(mean_difference(first.image(), second.image()), 0.3);
  (void)second.on_event(key_event('0'));
  EXPECT_EQ(second.on_idle({}).state["shape"][0], 0);
}

TEST(ExploreSession, StartsWithTheFaceOfTheImage) {
  const face::appearance::TrainingImage unseen =
      face::appearance::test_support::portraits(1, 33)[0];
  ExploreSession session(model(), ExploredImage{unseen.image, unseen.points}, 1);
  const cv::Mat own = session.image();
  EXPECT_EQ(own.size(), unseen.image.size());
  EXPECT_LT(mean_difference(own, unseen.image), 12) << "the model explains what it is drawn over";
  (void)session.on_event(slider_event("shape 1", 3));
  EXPECT_GT(mean_difference(session.image(), own), 0.3);
  // Far from the face nothing changes.
  EXPECT_EQ(cv::norm(session.image().row(0), unseen.image.row(0), cv::NORM_INF), 0);
  (void)session.on_event(key_event('f'));
  EXPECT_EQ(mean_difference(session.image(), own), 0);
  (void)session.on_event(key_event('o'));
  EXPECT_NE(session.image().size(), unseen.image.size());
}

TEST(ExploreSession, RefusesPointsOfAnotherModel) {
  const face::appearance::TrainingImage unseen =
      face::appearance::test_support::portraits(1, 33)[0];
  EXPECT_THROW(ExploreSession(model(), ExploredImage{unseen.image, unseen.points.leftCols(5)}, 1),
               std::invalid_argument);
}

TEST(ShapeSpaceSession, SlidersMoveTheShapeAmongTheTrainingShapes) {
  std::vector<Eigen::Matrix2Xd> shapes;
  face::shape::LandmarkSet set;
  for (const face::appearance::TrainingImage& image :
       face::appearance::test_support::portraits(20, 1)) {
    shapes.push_back(image.points);
    set.samples.emplace_back();
    set.samples.back().points = image.points;
  }
  ShapeSpaceSession session(face::shape::train_shape_model(set, {}), shapes);
  ASSERT_EQ(session.sliders().size(), 2U);
  const cv::Mat mean = session.image();
  (void)session.on_event(slider_event("mode 1", 2));
  EXPECT_GT(mean_difference(session.image(), mean), 0.05);
  const cv::Mat with = session.image();
  (void)session.on_event(key_event('t'));
  EXPECT_GT(mean_difference(session.image(), with), 0.05) << "the training shapes were drawn";
  test_support::expect_plain_image(session);
  EXPECT_TRUE(session.on_event(key_event('q')).finished);
}

TEST(ExploreSession, WithoutStatusShowsOnlyTheImage) {
  ExploreSession session(model(), std::nullopt, 1);
  test_support::expect_plain_image(session);
  EXPECT_EQ(mean_difference(session.on_idle({}).image, session.image()), 0);
}

}  // namespace
}  // namespace tarsier
