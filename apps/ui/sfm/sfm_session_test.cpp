// SPDX-License-Identifier: MIT
#include "ui/sfm/sfm_session.h"

#include "tarsier/media/testing_folder.h"
#include "tarsier/synth/sfm_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "ui/scripted_host.h"
#include "ui/testing_plain.h"
#include "ui/testing_stages.h"
#include <memory>
#include <string>
#include <vector>

namespace tarsier {
namespace {

// A drawn video: the camera goes along a wall.
class WalkSource final : public FrameSource {
 public:
  explicit WalkSource(std::vector<cv::Mat> images) : images_(std::move(images)) {}
  std::optional<Frame> next(std::chrono::milliseconds, const std::stop_token&) override {
    if (ended()) return std::nullopt;
    Frame frame;
    frame.image = images_[at_];
    frame.index = static_cast<std::int64_t>(at_);
    frame.time = static_cast<double>(at_) / 10;
    frame.name = "walk";
    ++at_;
    return frame;
  }
  [[nodiscard]] bool ended() const override { return at_ == images_.size(); }
  [[nodiscard]] bool is_live() const override { return false; }
  [[nodiscard]] SourceStatus status() const override {
    SourceStatus status;
    status.state = SourceState::kLive;
    return status;
  }
  [[nodiscard]] double fps() const override { return 10; }
  [[nodiscard]] std::int64_t count() const override {
    return static_cast<std::int64_t>(images_.size());
  }
  [[nodiscard]] const std::vector<std::string>& skipped() const override { return skipped_; }

 private:
  std::vector<cv::Mat> images_;
  std::size_t at_ = 0;
  std::vector<std::string> skipped_;
};

class SfmSessionTest : public FolderTest {
 protected:
  static void SetUpTestSuite() {
    synth::SceneOptions options;
    options.size = {320, 240};
    options.images = 24;
    options.trajectory = synth::Trajectory::kLine;
    const synth::SfmScene scene(options);
    camera_ = new geometry::Camera(scene.camera());
    video_ = new std::vector<cv::Mat>();
    for (int i = 0; i < scene.count(); ++i) video_->push_back(scene.render(i));
  }
  static void TearDownTestSuite() {
    delete video_;
    delete camera_;
  }

  void SetUp() override {
    options_ = {};
    options_.mapper.pipeline.camera = *camera_;
    options_.mapper.pipeline.features.max_count = 700;
    options_.mapper.overlap = 4;
    options_.frames_folder = folder_;
  }

  // The one session of now, and what it shows.
  SfmSession make(const std::stop_token& stop = {}, DebugSink* debug = nullptr) {
    online_ = std::make_unique<sfm::OnlineReconstructor>(options_);
    return SfmSession(*online_, stop, debug);
  }

  static double green_share(const cv::Mat& image) {
    cv::Mat green;
    cv::inRange(image, cv::Scalar(50, 200, 50), cv::Scalar(70, 220, 70), green);
    return cv::mean(green)[0] / 255;
  }

  static std::vector<cv::Mat>* video_;
  static geometry::Camera* camera_;
  sfm::OnlineReconstructorOptions options_;
  std::unique_ptr<sfm::OnlineReconstructor> online_;
};
std::vector<cv::Mat>* SfmSessionTest::video_ = nullptr;
geometry::Camera* SfmSessionTest::camera_ = nullptr;

TEST_F(SfmSessionTest, GrowsAndDrawsTheModelDuringTheVideo) {
  SfmSession session = make();
  const cv::Mat untouched = (*video_)[23].clone();
  WalkSource walk(*video_);
  ScriptedHost host(session, walk);
  host.keep_images(0);
  host.keep_images(23);
  const auto& steps = host.run();
  ASSERT_EQ(steps.size(), 24U);
  EXPECT_EQ(steps.front().state["key_frames"], 1);
  EXPECT_EQ(steps.front().state["registered"], 0);
  int grown = 0;
  for (std::size_t k = 1; k < steps.size(); ++k) {
    const int before = steps[k - 1].state["registered"];
    const int now = steps[k].state["registered"];
    EXPECT_GE(now, before);
    grown += now > before;
  }
  EXPECT_GE(grown, 3) << "the model did not grow while the video ran";
  EXPECT_GT(steps.back().state["points"], 150);
  EXPECT_GT(steps.back().state["followed"], 30);

  const View end = session.finish();
  EXPECT_EQ(end.state["registered"], online_->inputs().size()) << end.status;
  EXPECT_GE(online_->inputs().size(), 8U);

  // Points of the model on the video, and a cloud beside it.
  ASSERT_FALSE(steps.front().output.empty());
  const cv::Mat& first = steps.front().output;
  const cv::Mat& last = steps.back().output;
  EXPECT_EQ(first.size(), last.size());
  EXPECT_EQ(last.size(), cv::Size(640, 240));
  const cv::Rect left(0, 0, 320, 240);
  const cv::Rect right(320, 0, 320, 240);
  EXPECT_LT(green_share(first(left)), 0.001);
  EXPECT_GT(green_share(last(left)), 0.01);
  cv::Mat change;
  cv::absdiff(first(right), last(right), change);
  EXPECT_GT(cv::mean(change)[0], 3) << "there is no cloud";
  EXPECT_EQ(cv::norm((*video_)[23], untouched, cv::NORM_INF), 0) << "the video was drawn on";
}

TEST_F(SfmSessionTest, SaysWhyThereIsNoModel) {
  synth::SceneOptions turned;
  turned.size = {320, 240};
  turned.images = 4;
  turned.pure_rotation = true;
  const synth::SfmScene scene(turned);
  options_.mapper.pipeline.camera = scene.camera();
  options_.every_frame = true;
  std::vector<cv::Mat> images;
  for (int i = 0; i < scene.count(); ++i) images.push_back(scene.render(i));
  SfmSession session = make();
  WalkSource source(images);
  ScriptedHost host(session, source);
  EXPECT_FALSE(host.run().front().state.contains("no_model"));
  const View end = session.finish();
  EXPECT_EQ(end.state["registered"], 0);
  EXPECT_THAT(end.state["no_model"].get<std::string>(), testing::HasSubstr("sideways"));
  // The reason fills several lines of the panel.
  const auto drawn_rows = [](const cv::Mat& image) {
    int rows = 0;
    for (int y = 60; y < 200; ++y) {
      cv::Mat row;
      cv::reduce(image(cv::Rect(330, y, 300, 1)), row, 1, cv::REDUCE_MIN);
      rows += row.at<cv::Vec3b>(0, 0)[0] < 120 ? 1 : 0;
    }
    return rows;
  };
  EXPECT_GT(drawn_rows(end.image), 20);
}

TEST_F(SfmSessionTest, IsDeterministic) {
  std::string transcripts[2];
  for (std::string& transcript : transcripts) {
    SfmSession session = make();
    WalkSource walk({video_->begin(), video_->begin() + 12});
    ScriptedHost host(session, walk);
    host.schedule(6, key_event('r'));
    for (const ScriptStep& step : host.run()) transcript += step.state.dump() + "\n";
  }
  EXPECT_EQ(transcripts[0], transcripts[1]);
}

TEST_F(SfmSessionTest, RotatesAndZoomsOnlyTheCloud) {
  SfmSession session = make();
  WalkSource walk({video_->begin(), video_->begin() + 12});
  ScriptedHost host(session, walk);
  host.run();
  const cv::Rect left(0, 0, 320, 200);  // above the status
  const cv::Rect right(320, 40, 320, 160);
  cv::Mat before = session.on_event(key_event('x')).image.clone();
  const cv::Mat first = before.clone();
  const auto changes = [&](const Event& event) {
    const View view = session.on_event(event);
    EXPECT_EQ(cv::norm(view.image(left), before(left), cv::NORM_INF), 0);
    const double change = cv::norm(view.image(right), before(right), cv::NORM_L1);
    before = view.image.clone();
    return change > 0;
  };
  for (const int key : {key::kLeft, key::kUp, key::kDown, key::kRight, static_cast<int>('+'),
                        static_cast<int>('-')}) {
    EXPECT_TRUE(changes(key_event(key))) << key;
  }
  EXPECT_TRUE(changes(action_event("nearer")));
  Event mouse;
  mouse.kind = Event::Kind::kMouse;
  mouse.mouse = Event::Mouse::kMove;
  mouse.x = 500;
  mouse.y = 100;
  EXPECT_FALSE(changes(mouse)) << "no button is down";
  mouse.mouse = Event::Mouse::kLeftDown;
  EXPECT_FALSE(changes(mouse));
  mouse.mouse = Event::Mouse::kMove;
  mouse.x = 440;
  EXPECT_TRUE(changes(mouse));
  mouse.mouse = Event::Mouse::kLeftUp;
  EXPECT_FALSE(changes(mouse));
  mouse.mouse = Event::Mouse::kMove;
  mouse.x = 300;
  EXPECT_FALSE(changes(mouse));
  mouse.mouse = Event::Mouse::kWheel;
  mouse.wheel = 2;
  EXPECT_TRUE(changes(mouse));
  EXPECT_TRUE(changes(key_event('0')));
  EXPECT_EQ(cv::norm(before(right), first(right), cv::NORM_INF), 0) << "not the first view again";
}

TEST_F(SfmSessionTest, PassesStagesToAWatchingSink) {
  SfmSession plain = make();
  WalkSource walk({video_->begin(), video_->begin() + 12});
  ScriptedHost host(plain, walk);
  host.keep_images(11);
  const cv::Mat expected = host.run().back().output.clone();

  test_support::WatchedStages stages;
  SfmSession session = make({}, &stages);
  SourceStatus live;
  live.state = SourceState::kLive;
  View view;
  for (int i = 0; i < 12; ++i) {
    stages.watched = i == 11;
    Frame frame;
    frame.image = (*video_)[static_cast<std::size_t>(i)];
    frame.index = i;
    frame.time = i / 10.0;
    frame.name = "walk";
    view = session.on_frame(frame, live);
    EXPECT_EQ(stages.names.empty(), i < 11) << i;
  }
  EXPECT_THAT(stages.names, ::testing::ElementsAre("motion", "features", "matches", "tracks"));
  EXPECT_TRUE(stages.are_images);
  EXPECT_EQ(cv::norm(view.output, expected, cv::NORM_INF), 0) << "looking changes the drawing";
}

TEST_F(SfmSessionTest, PausesAndQuits) {
  SfmSession session = make();
  SourceStatus live;
  live.state = SourceState::kLive;
  Frame frame;
  frame.image = (*video_)[0];
  session.on_frame(frame, live);
  EXPECT_TRUE(session.on_event(key_event(key::kSpace)).state["paused"]);
  frame.image = (*video_)[12];
  frame.index = 12;
  const View paused = session.on_frame(frame, live);  // a camera goes on
  EXPECT_EQ(paused.state["key_frames"], 1);
  EXPECT_TRUE(paused.output.empty());
  EXPECT_FALSE(session.on_event(key_event(key::kSpace)).state["paused"]);
  EXPECT_FALSE(session.on_event(key_event('h')).finished);
  EXPECT_TRUE(session.on_event(key_event('q')).finished);
}

TEST_F(SfmSessionTest, TakesEachImageOfAFolder) {
  options_.every_frame = true;
  options_.grow_every = 2;
  SfmSession session = make();
  WalkSource walk({(*video_)[0], (*video_)[2], (*video_)[4], (*video_)[6], (*video_)[8]});
  ScriptedHost host(session, walk);
  const auto& steps = host.run();
  ASSERT_EQ(steps.size(), 5U);
  for (std::size_t k = 0; k < steps.size(); ++k) EXPECT_EQ(steps[k].state["key_frames"], k + 1);
  EXPECT_EQ(steps[3].state["registered"], 4);
  EXPECT_EQ(session.finish().state["registered"], 5);
}

TEST_F(SfmSessionTest, SurvivesAStopAndAPlainVideo) {
  std::stop_source stop;
  SfmSession session = make(stop.get_token());
  WalkSource walk({video_->begin(), video_->begin() + 9});
  stop.request_stop();
  ScriptedHost host(session, walk);
  host.run();
  EXPECT_GE(online_->inputs().size(), 3U);
  EXPECT_EQ(session.finish().state["registered"], 0);

  SfmSession plain = make();
  const cv::Mat grey(240, 320, CV_8UC3, cv::Scalar::all(120));
  WalkSource nothing({grey, grey, grey});
  ScriptedHost(plain, nothing).run();
  EXPECT_EQ(plain.finish().state["points"], 0);
}

TEST_F(SfmSessionTest, WithoutStatusShowsOnlyTheDrawing) {
  SfmSession session = make();
  session.draw_status(false);
  Frame frame;
  frame.image = video_->front();
  SourceStatus live;
  live.state = SourceState::kLive;
  const View view = session.on_frame(frame, live);
  EXPECT_EQ(cv::norm(view.image, view.output, cv::NORM_INF), 0);
  test_support::expect_plain_image(session, live);
}

}  // namespace
}  // namespace tarsier
