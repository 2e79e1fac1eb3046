// SPDX-License-Identifier: MIT
#include "tarsier/core/rng.h"
#include "tarsier/face/appearance/start.h"
#include "tarsier/face/appearance/tracker.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/media/image_file.h"
#include "tarsier/synth/face/synth_face.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include "bench.h"
#include "framework/stopwatch.h"
#include "verbs/aam/engine.h"
#include "verbs/pose/engine.h"
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

using face::appearance::AppearanceModel;
using face::appearance::FitOptions;
using face::appearance::Method;

geometry::Rigid3 pose_at(double yaw, double distance) {
  return {face::head::rotation_of_angles({yaw, 3, 2}), {0, 10, distance}};
}

// Trains a small grey model from synthetic heads.
AppearanceModel small_model(const synth::FaceSynth& faces, int width, int modes) {
  geometry::Camera camera = face::head::guess_camera({240, 240});
  std::vector<face::appearance::TrainingImage> images;
  Rng rng(1);
  for (std::uint64_t i = 0; i < 60; ++i) {
    face::appearance::TrainingImage image;
    image.points = faces
                       .draw(image.image, faces.person(i, 1), camera,
                             pose_at(rng.uniform(-20, 20), 450), {}, i)
                       .points;
    images.push_back(std::move(image));
  }
  face::appearance::AppearanceOptions options;
  options.frame_width = width;
  options.levels = 1;
  options.colour = false;
  options.shape.variance = 1;
  options.shape.max_modes = modes;
  NoProgress silent;
  return face::appearance::train_appearance_model(images, {}, options, silent, {});
}

void report(const Context& context, const char* name, double ms, const std::string& about) {
  if (context.json) {
    print_json(nlohmann::ordered_json{
        {"bench", "aam"}, {"case", name}, {"ms", rounded(ms, 4)}, {"about", about}});
  } else {
    print_text(fmt::format("{:<26} {:>9.3f} ms   {}\n", name, ms, about));
  }
}

// Time of one iteration at the finest level: the difference between many and few iterations.
double iteration_ms(const AppearanceModel& model, Method method, const cv::Mat& image,
                    const Eigen::Matrix2Xd& start, int repeats) {
  const auto time_of = [&](int iterations) {
    FitOptions options;
    options.method = method;
    options.iterations = iterations;
    options.tolerance = 1e-12;
    options.coarsest = 0;
    const face::appearance::Fitter fitter(model, options);
    face::appearance::FitWorkspace workspace;
    return median_ms(repeats, [&] { (void)fitter.fit(image, start, workspace); });
  };
  constexpr int kFew = 5;
  constexpr int kMany = 45;
  return (time_of(kMany) - time_of(kFew)) / (kMany - kFew);
}

}  // namespace

ExitStatus bench_aam(Context& context, const BenchOptions& options) {
  const AppearanceModel model = face::appearance::read_appearance_model(shipped_appearance_model());
  const face::head::HeadModel head = read_head("");
  const synth::FaceSynth faces(model, head);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  geometry::Camera camera = face::head::guess_camera({640, 480});
  cv::Mat image;
  const Eigen::Matrix2Xd truth =
      faces.draw(image, faces.person(100), camera, pose_at(5, 600), {}, 1).points;
  const auto start_of = [&](const AppearanceModel& any) {
    return Eigen::Matrix2Xd(
        face::shape::fit_similarity(any.shape.mean, truth)(any.shape.mean).colwise() +
        Eigen::Vector2d(4, -3));
  };
  if (is_chosen(options, "project-out-iteration") || is_chosen(options, "alternating-iteration")) {
    constexpr int kModes = 20;
    const AppearanceModel grey = small_model(faces, 100, kModes);
    const std::string about = fmt::format(
        "grey, {}x{}, {} pixels, {} shape modes, {} texture modes",
        grey.levels[0].warp.size().width, grey.levels[0].warp.size().height,
        grey.levels[0].warp.pixels().size(), grey.shape.mode_count(), grey.levels[0].mode_count());
    if (is_chosen(options, "project-out-iteration"))
      report(context, "project-out-iteration",
             iteration_ms(grey, Method::kProjectOut, image, start_of(grey), options.repeats),
             about);
    if (is_chosen(options, "alternating-iteration"))
      report(context, "alternating-iteration",
             iteration_ms(grey, Method::kAlternating, image, start_of(grey), options.repeats),
             about);
  }
  const std::string about =
      fmt::format("{} features of {} px, {} shape modes, {} texture modes",
                  channel_count(model.levels[0].channels), model.levels[0].warp.size().width,
                  model.shape.mode_count(), model.levels[0].mode_count());
  for (const auto& [name, method] : {std::pair{"fit-project-out", Method::kProjectOut},
                                     std::pair{"fit-alternating", Method::kAlternating}}) {
    if (!is_chosen(options, name)) continue;
    FitOptions fit;
    fit.method = method;
    const face::appearance::Fitter fitter(model, fit);
    face::appearance::FitWorkspace workspace;
    const Eigen::Matrix2Xd start = start_of(model);
    report(context, name,
           median_ms(options.repeats, [&] { (void)fitter.fit(image, start, workspace); }), about);
  }
  if (is_chosen(options, "track")) {
    // A head that turns: the fit from frame to frame, and the pose of the head.
    std::vector<cv::Mat> video;
    for (int i = 0; i < 30; ++i) {
      video.emplace_back();
      faces.draw(video.back(), faces.person(100), camera,
                 pose_at(25 * std::sin(i * 0.2), 600 + 3.0 * i), {}, 1);
    }
    FitOptions fit;
    fit.method = Method::kAlternating;
    const face::appearance::Fitter fitter(model, fit);
    const face::head::HeadPoseEstimator estimator(head);
    const face::appearance::FindStarts find = [&](const cv::Mat&) {
      return std::vector<std::vector<Eigen::Matrix2Xd>>{{start_of(model)}};
    };
    const int repeats = std::max(1, options.repeats / 5);
    const double ms = median_ms(repeats, [&] {
      face::appearance::Track track;
      face::head::HeadIdentity identity;
      double time = 0;
      for (const cv::Mat& frame : video) {
        for (const face::appearance::TrackedObject& face :
             face::appearance::track_objects(fitter, {}, find, track, frame, time))
          (void)estimator.pose(face.fit.points, camera, identity);
        time += 0.04;
      }
    });
    const double each = ms / static_cast<double>(video.size());
    report(context, "track", each,
           fmt::format("640x480, model and pose: {:.0f} frames/s", 1000 / each));
  }
  cv::setNumThreads(threads);
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
