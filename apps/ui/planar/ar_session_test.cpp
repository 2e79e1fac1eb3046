// SPDX-License-Identifier: MIT
#include "ui/planar/ar_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/geometry/scaled_camera.h"
#include "tarsier/render/builtin.h"
#include "tarsier/synth/planar_source.h"
#include "tarsier/synth/sources.h"

#include <gtest/gtest.h>

#include "ui/scripted_host.h"
#include "ui/testing_keep.h"
#include <chrono>
#include <filesystem>
#include <string>
#include <unistd.h>

namespace tarsier {
namespace {

constexpr const char* kVideo = "markers?size=480x360&fps=10&frames=24&cover=0&speed=8&shutter=0";

synth::PlanarVideo truth() {
  synth::PlanarSourceOptions options;
  options.video.with_occluder = false;
  options.video.speed_px = 8;
  options.video.shutter = 0;
  return synth::planar_source_video(options, {480, 360}, 10, 1);
}

planar::MarkerTracker tracker() {
  planar::MarkerTrackerOptions options;
  options.camera = truth().camera();
  return planar::MarkerTracker::load(options);
}

ArSessionOptions options() {
  ArSessionOptions options;
  options.augment.mesh = std::make_shared<const render::Mesh>(
      planar::augment::upright_mesh(render::make_sphere(16, {0.2F, 0.5F, 0.9F})));
  return options;
}

TEST(ArSessionTest, ReportsMarkerDistancesAndDraws) {
  ArSession session(tracker(), options());
  const auto source = synth::open_synth_source(kVideo);
  ScriptedHost host(session, *source);
  host.schedule(6, key_event('a'));
  host.schedule(8, key_event('m'));
  host.schedule(10, key_event('i'));
  host.schedule(12, key_event('l'));
  host.schedule(14, key_event('n'));
  host.schedule(16, key_event('h'));
  for (const int frame : {5, 7, 9, 11, 13, 15, 17}) host.keep_images(frame);
  const auto& steps = host.run();
  const auto video = truth();
  for (const ScriptStep& step : steps) {
    if (!step.image.empty())
      test_support::keep_image(step.image, "ar-" + std::to_string(step.frame));
    if (step.cause != "frame") continue;
    EXPECT_GE(step.state["markers"], 3) << step.frame;
    for (std::size_t i = 0; i < step.state["ids"].size(); ++i) {
      for (const auto& print : video.truth_at(static_cast<double>(step.frame) / 10)) {
        if (print.id != step.state["ids"][i]) continue;
        const double away = print.camera_from_print.translation.norm();
        EXPECT_NEAR(step.state["distance_m"][i].get<double>(), away, 0.02 * away) << step.frame;
      }
    }
    if (step.frame == 5) {
      EXPECT_EQ(step.state["draw"], "cube");
    }
    if (step.frame == 7) {
      EXPECT_EQ(step.state["draw"], "axes");
    }
    if (step.frame == 15) {  // nothing at all: the image as it came
      const cv::Mat plain = step.output;
      const cv::Mat video_image = video.image_at(1.5);
      EXPECT_LT(cv::norm(plain, video_image, cv::NORM_INF), 15);  // noise
    }
  }
}

TEST(ArSessionTest, PausesSavesAndChangesTheFamily) {
  const auto folder =
      std::filesystem::temp_directory_path() /
      ("tarsier-ar-" + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) +
       std::to_string(::getpid()));
  ArSessionOptions how = options();
  how.save_folder = folder.string();
  ArSession session(tracker(), how);
  const auto source = synth::open_synth_source(kVideo);
  const auto frame = source->next(std::chrono::milliseconds(1000), {});
  ASSERT_TRUE(frame);
  View view = session.on_frame(*frame, source->status());
  EXPECT_EQ(view.state["paused"], false);
  EXPECT_EQ(session.on_event(key_event(key::kSpace)).state["paused"], true);
  const cv::Mat cube = session.on_event(key_event('c')).image.clone();
  const cv::Mat axes = session.on_event(key_event('a')).image.clone();
  EXPECT_GT(cv::norm(cube, axes, cv::NORM_INF), 60);  // drawn again on the frozen image
  view = session.on_event(key_event('w'));
  EXPECT_TRUE(std::filesystem::exists(view.state["saved"].get<std::string>()));
  EXPECT_EQ(session.on_event(key_event('s')).state["smooth"], false);
  EXPECT_EQ(session.on_event(key_event('e')).state["shadow"], false);
  view = session.on_event(key_event('f'));
  EXPECT_NE(view.state["family"], "36h11");
  EXPECT_EQ(view.state["markers"], 0);
  EXPECT_TRUE(session.on_event(key_event('q')).finished);
  std::filesystem::remove_all(folder);
}

TEST(ArSessionTest, RefusesACameraOfAnotherAspectRatio) {
  planar::MarkerTrackerOptions how;
  how.camera = geometry::guessed_camera({1280, 720});
  ArSession session(planar::MarkerTracker::load(how), options());
  const auto source = synth::open_synth_source(kVideo);
  const auto frame = source->next(std::chrono::milliseconds(1000), {});
  EXPECT_THROW((void)session.on_frame(*frame, source->status()), InputError);
}

}  // namespace
}  // namespace tarsier
