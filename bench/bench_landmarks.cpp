// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/landmarks/tracker.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "bench.h"
#include "framework/stopwatch.h"
#include "verbs/landmarks/engine.h"
#include "verbs/program/sample_images.h"
#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
// Fits on one thread. Tracking is of a still face in an image of 640x480, including searches.
ExitStatus bench_landmarks(Context& context, const BenchOptions& options) {
  cv::setNumThreads(1);
  const LandmarkFlags flags;
  const face::LandmarkTracker tracker = load_landmark_tracker(flags);
  const face::landmarks::LandmarkModel& full_model = tracker.model();
  face::landmarks::FaceFinder finder = tracker.detector().make_finder();
  const std::string path =
      options.inputs.empty() ? sample_image("messi5.jpg") : options.inputs.front();
  const cv::Mat gray = read_gray_image(path);
  const std::vector<face::landmarks::Candidate> found = finder.find(gray);
  if (found.empty()) throw InputError(path, "shows no face to measure on");
  const Eigen::Matrix2Xd start = face::landmarks::start_at(full_model, finder, found.front());
  const auto report = [&](const std::string& name, double ms) {
    if (context.json) {
      nlohmann::ordered_json line = {
          {"bench", "landmarks"}, {"case", name}, {"ms", rounded(ms, 3)}};
      print_json(line);
    } else {
      print_text(fmt::format("{:<12} {:8.3f} ms\n", name, ms));
    }
  };
  face::landmarks::FitWorkspace workspace;
  for (const face::landmarks::FitMethod method :
       {face::landmarks::FitMethod::kMean, face::landmarks::FitMethod::kTrees,
        face::landmarks::FitMethod::kDescent, face::landmarks::FitMethod::kNetwork,
        face::landmarks::FitMethod::kPatches}) {
    throw_if_stopped(context.stop);
    if (!full_model.has(method)) continue;
    face::landmarks::LandmarkModel model = full_model;
    model.quality.reset();
    face::landmarks::FitOptions fit;
    fit.method = method;
    report(fmt::format("fit-{}", name_of(method)), median_ms(options.repeats, [&] {
             (void)face::landmarks::fit_points(model, fit, gray, start, workspace);
           }));
  }
  report("detect", median_ms(options.repeats, [&] { (void)finder.find_confident(gray); }));
  // Faces from the default 40 px; the image fills the frame.
  cv::Mat wide;
  cv::resize(gray, wide, cv::Size(1920, 1080), 0, 0, cv::INTER_LINEAR);
  report("detect-1080p", median_ms(options.repeats, [&] { (void)finder.find_confident(wide); }));
  cv::Mat frame;
  cv::resize(gray, frame, cv::Size(640, 480), 0, 0, cv::INTER_AREA);
  face::LandmarkState state;
  Frame at_rest;
  at_rest.image = frame;
  constexpr int kFrames = 50;
  double time = 0;
  report("track-frame", median_ms(std::max(1, options.repeats / 3), [&] {
                          for (int i = 0; i < kFrames; ++i, time += 0.04) {
                            at_rest.time = time;
                            (void)tracker.process(at_rest, state);
                          }
                        }) / kFrames);
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
