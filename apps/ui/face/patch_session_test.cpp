// SPDX-License-Identifier: MIT
#include "ui/face/patch_session.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "ui/scripted_host.h"
#include "ui/testing_plain.h"
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace tarsier {
namespace {

constexpr int kSide = 11;

// Four patches that are bright disks, at the corners of a square of 60 px; the image shows such
// disks where its points are, but for the last, which is off by (3, -2) px.
class PatchSessionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    Eigen::Matrix2Xd square(2, 4);
    square << -30, 30, -30, 30, -30, -30, 30, 30;
    model_.reference = square;
    cv::Mat patch(kSide, kSide, CV_32FC1, cv::Scalar(0));
    cv::circle(patch, {kSide / 2, kSide / 2}, 3, cv::Scalar(1), cv::FILLED);
    patch -= cv::mean(patch)[0];
    patch /= cv::norm(patch);
    model_.patches.assign(4, patch);
    std::vector<Eigen::Matrix2Xd> shapes{square, square * 1.1};
    shape_ = face::shape::train_shape_model(shapes);

    image_.name = "disks.png";
    image_.points = square.array() + 80;
    image_.gray = cv::Mat(160, 160, CV_8UC1, cv::Scalar(60));
    for (Eigen::Index i = 0; i < 4; ++i) {
      const cv::Point off = i == 3 ? cv::Point(3, -2) : cv::Point();
      cv::circle(
          image_.gray,
          cv::Point(static_cast<int>(image_.points(0, i)), static_cast<int>(image_.points(1, i))) +
              off,
          3, cv::Scalar(220), cv::FILLED);
    }
  }
  PatchSession session(bool with_image) {
    return {model_, shape_, with_image ? std::optional(image_) : std::nullopt};
  }

  face::regression::PatchModels model_;
  face::shape::ShapeModel shape_;
  PatchImage image_;
};

// No frames: a session of events alone.
class EmptySource final : public FrameSource {
 public:
  std::optional<Frame> next(std::chrono::milliseconds, const std::stop_token&) override {
    return std::nullopt;
  }
  [[nodiscard]] bool ended() const override { return true; }
  [[nodiscard]] bool is_live() const override { return false; }
  [[nodiscard]] SourceStatus status() const override { return {}; }
  [[nodiscard]] double fps() const override { return 0; }
  [[nodiscard]] std::int64_t count() const override { return 0; }
  [[nodiscard]] const std::vector<std::string>& skipped() const override { return skipped_; }

 private:
  std::vector<std::string> skipped_;
};

TEST_F(PatchSessionTest, KeysCycleThroughAllPatches) {
  PatchSession session = this->session(false);
  EmptySource source;
  ScriptedHost host(session, source);
  const std::vector<int> keys{'n', 'n', key::kRight, key::kSpace, key::kLeft, 'p', 'q'};
  for (const int key : keys) host.schedule(0, key_event(key));
  std::vector<int> patches;
  for (const ScriptStep& step : host.run()) patches.push_back(step.state.at("patch"));
  EXPECT_EQ(patches, (std::vector<int>{1, 2, 3, 0, 3, 2, 2}));
  EXPECT_TRUE(host.steps().back().finished);
  EXPECT_TRUE(host.steps().back().state.at("peak").is_null()) << "there is no image";
}

TEST_F(PatchSessionTest, ReportsTheOffsetOfTheResponsePeak) {
  PatchSession session = this->session(true);
  View view = session.on_idle({});
  EXPECT_EQ(view.state.at("peak"), (std::vector<int>{0, 0}));
  EXPECT_GT(view.state.at("response").get<double>(), 0.9);
  for (int k = 0; k < 3; ++k) view = session.on_event(key_event('n'));
  EXPECT_EQ(view.state.at("peak"), (std::vector<int>{3, -2}));
  view = session.on_event(key_event('w'));
  EXPECT_EQ(view.state.at("search"), 31);
  EXPECT_EQ(view.state.at("peak"), (std::vector<int>{3, -2})) << "a wider region, the same peak";
}

TEST_F(PatchSessionTest, ClicksSelectButtonsAndPatches) {
  PatchSession session = this->session(false);
  const auto click = [&](double x, double y) {
    Event event;
    event.kind = Event::Kind::kMouse;
    event.mouse = Event::Mouse::kLeftDown;
    event.x = x;
    event.y = y;
    return session.on_event(event).state.at("patch").get<int>();
  };
  // The face is a square in the left half: its corners are the patches.
  EXPECT_EQ(click(420, 470), 3);
  EXPECT_EQ(click(90, 470), 2);
  EXPECT_EQ(click(185, 558), 3) << "next";
  EXPECT_EQ(click(60, 558), 2) << "previous";
  EXPECT_EQ(click(990, 610), 2) << "nothing there";
}

TEST_F(PatchSessionTest, EachPatchIsDrawnDifferently) {
  PatchSession session = this->session(true);
  const cv::Mat first = session.on_idle({}).image.clone();
  const cv::Mat second = session.on_event(key_event('n')).image.clone();
  EXPECT_GT(cv::norm(first, second, cv::NORM_INF), 50);
  const cv::Mat back = session.on_event(key_event('p')).image.clone();
  EXPECT_EQ(cv::norm(first, back, cv::NORM_INF), 0);
}

TEST_F(PatchSessionTest, RefusesMismatchedModelParts) {
  model_.patches.pop_back();
  model_.reference = Eigen::Matrix2Xd(model_.reference.leftCols(3));
  EXPECT_THROW(this->session(false), std::invalid_argument);
}

TEST_F(PatchSessionTest, WithoutStatusDrawsNoBar) {
  PatchSession session = this->session(true);
  test_support::expect_plain_image(session);
}

}  // namespace
}  // namespace tarsier
