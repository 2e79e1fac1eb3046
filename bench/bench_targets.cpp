// SPDX-License-Identifier: MIT
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"
#include "tarsier/planar/image_targets/track.h"
#include "tarsier/planar/image_targets/train.h"
#include "tarsier/synth/planar_source.h"
#include "tarsier/synth/planar_worlds.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "bench.h"
#include "measure.h"
#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

namespace tarsier::cli {
namespace {

using Json = nlohmann::ordered_json;
using Corners = std::array<cv::Point2d, 4>;

constexpr int kStillsPerLevel = 30;
constexpr double kVideoSeconds = 12;
constexpr double kFps = 25;
constexpr double kWidth = 0.2;  // m, of the prints

double rms_of(const Corners& a, const Corners& b) {
  double sum = 0;
  for (std::size_t i = 0; i < 4; ++i) sum += (a[i] - b[i]).dot(a[i] - b[i]);
  return std::sqrt(sum / 4);
}

// The textbook method: features, ratio test, a homography by RANSAC.
class TextbookFinder {
 public:
  TextbookFinder(cv::Ptr<cv::Feature2D> features, cv::NormTypes norm, double ratio,
                 const cv::Mat& image)
      : features_(std::move(features)), matcher_(norm), ratio_(ratio), size_(image.size()) {
    features_->detectAndCompute(image, cv::noArray(), points_, descriptors_);
  }

  [[nodiscard]] std::optional<Corners> find(const cv::Mat& gray) const {
    std::vector<cv::KeyPoint> points;
    cv::Mat descriptors;
    features_->detectAndCompute(gray, cv::noArray(), points, descriptors);
    if (points.size() < 2 || points_.size() < 2) return std::nullopt;
    std::vector<std::vector<cv::DMatch>> pairs;
    matcher_.knnMatch(descriptors, descriptors_, pairs, 2);
    std::vector<cv::Point2f> from;
    std::vector<cv::Point2f> to;
    for (const auto& pair : pairs) {
      if (pair.size() < 2 || pair[0].distance >= ratio_ * pair[1].distance) continue;
      from.push_back(points_[static_cast<std::size_t>(pair[0].trainIdx)].pt);
      to.push_back(points[static_cast<std::size_t>(pair[0].queryIdx)].pt);
    }
    if (from.size() < 8) return std::nullopt;
    std::vector<std::uint8_t> inliers;
    const cv::Mat h = cv::findHomography(from, to, cv::RANSAC, 3, inliers, 2000);
    if (h.empty() || std::count(inliers.begin(), inliers.end(), 1) < 10) return std::nullopt;
    const float w = static_cast<float>(size_.width) - 0.5F;
    const float b = static_cast<float>(size_.height) - 0.5F;
    std::vector<cv::Point2f> q{{-0.5F, -0.5F}, {w, -0.5F}, {w, b}, {-0.5F, b}};
    cv::perspectiveTransform(q, q, h);
    if (!cv::isContourConvex(q)) return std::nullopt;
    return Corners{q[0], q[1], q[2], q[3]};
  }

 private:
  cv::Ptr<cv::Feature2D> features_;
  cv::BFMatcher matcher_;
  double ratio_;
  cv::Size size_;
  std::vector<cv::KeyPoint> points_;
  cv::Mat descriptors_;
};

// The results of one method.
struct Tally {
  int visible = 0;
  int right = 0;
  int wrong = 0;
  std::vector<double> errors;
  std::vector<double> times;

  void add(const synth::PrintTruth* truth, const std::optional<Corners>& found, double ms) {
    times.push_back(ms);
    visible += truth != nullptr ? 1 : 0;
    if (!found) return;
    const double error = truth != nullptr ? rms_of(*found, truth->corners) : 1e9;
    if (truth == nullptr || error > std::max(3.0, 0.2 * truth->side_px)) {
      ++wrong;
      return;
    }
    ++right;
    errors.push_back(error);
  }
};

void print_row(Context& context, const char* case_name, const char* method, Tally tally,
               const Json& more = Json::object()) {
  const double corner_px = upper_quantile(tally.errors, 0.5);
  const double corner_px_p95 = upper_quantile(tally.errors, 0.95);
  const double ms = upper_quantile(tally.times, 0.5);
  const double ms_p95 = upper_quantile(tally.times, 0.95);
  Json row;
  row["bench"] = "targets";
  row["case"] = fmt::format("{} {}", case_name, method);
  row["method"] = method;
  row["images"] = tally.times.size();
  row["recall"] =
      rounded(tally.visible > 0 ? static_cast<double>(tally.right) / tally.visible : 0, 3);
  row["wrong"] = tally.wrong;
  row["corner_px"] = rounded(corner_px, 3);
  row["corner_px_p95"] = rounded(corner_px_p95, 3);
  row["ms"] = rounded(ms, 2);
  row["ms_p95"] = rounded(ms_p95, 2);
  for (const auto& [key, value] : more.items()) row[key] = value;
  if (context.json) {
    print_json(row);
    return;
  }
  print_text(fmt::format(
      "{:<8} {:<12} recall {:.3f} ({} of {}), wrong {}, corners {:.3f} px (95 % "
      "{:.2f}), {:.2f} ms (95 % {:.2f}){}\n",
      case_name, method, row["recall"].get<double>(), tally.right, tally.visible, tally.wrong,
      corner_px, corner_px_p95, ms, ms_p95,
      more.contains("rest_px") ? fmt::format(", at rest {:.3f} px", more["rest_px"].get<double>())
                               : ""));
}

struct TrainedMethods {
  std::vector<planar::image_targets::Target> tarsier_targets;
  std::vector<TextbookFinder> orb;
  std::vector<TextbookFinder> sift;
};

TrainedMethods train_all(const std::vector<synth::PlanarPrint>& prints, std::uint64_t seed) {
  TrainedMethods all;
  for (const synth::PlanarPrint& print : prints) {
    planar::image_targets::TrainOptions options;
    options.width = print.width;
    options.seed = seed;
    all.tarsier_targets.push_back(
        planar::image_targets::train_target(print.image, print.name, options));
    cv::Mat gray = print.image;
    if (gray.channels() == 3) cv::cvtColor(gray, gray, cv::COLOR_BGR2GRAY);
    all.orb.emplace_back(cv::ORB::create(1500), cv::NORM_HAMMING, 0.8, gray);
    all.sift.emplace_back(cv::SIFT::create(1500), cv::NORM_L2, 0.75, gray);
  }
  return all;
}

std::optional<Corners> find_with_tarsier(const std::vector<planar::image_targets::Target>& targets,
                                         std::size_t which, const cv::Mat& image) {
  const auto found = planar::image_targets::detect_targets({targets[which]}, image);
  if (found.empty()) return std::nullopt;
  return found[0].corners;
}

// Stills of one print each, at three levels each of light, blur and noise, one at a time.
void measure_stills(Context& context, const std::vector<synth::PlanarPrint>& prints,
                    const TrainedMethods& all) {
  Tally tarsier;
  Tally orb;
  Tally sift;
  for (const auto level :
       {synth::PlanarLevel::kEasy, synth::PlanarLevel::kMedium, synth::PlanarLevel::kHard}) {
    for (int k = 0; k < kStillsPerLevel; ++k) {
      throw_if_stopped(context.stop);
      synth::StillOptions options;
      options.max_prints = 1;
      options.min_side_px = 80;
      options.max_side_px = 280;
      options.hidden_share = 0.3;
      const auto which = static_cast<std::size_t>(k) % prints.size();
      const synth::PlanarStill still = synth::print_still(
          {prints[which]}, options, level, context.seed * 1000 + static_cast<std::uint64_t>(k));
      const synth::PrintTruth* truth = still.truth.empty() ? nullptr : &still.truth[0];
      cv::Mat gray;
      cv::cvtColor(still.image, gray, cv::COLOR_BGR2GRAY);
      double start = thread_cpu_ms();
      const auto a = find_with_tarsier(all.tarsier_targets, which, still.image);
      tarsier.add(truth, a, thread_cpu_ms() - start);
      start = thread_cpu_ms();
      const auto b = all.orb[which].find(gray);
      orb.add(truth, b, thread_cpu_ms() - start);
      start = thread_cpu_ms();
      const auto c = all.sift[which].find(gray);
      sift.add(truth, c, thread_cpu_ms() - start);
    }
  }
  print_row(context, "stills", "tarsier", tarsier);
  print_row(context, "stills", "ORB+RANSAC", orb);
  print_row(context, "stills", "SIFT+RANSAC", sift);
}

// One video per print: motion of 25 px per frame, tilt up to 50 degrees, two exposure times, a hand
// that passes in front.
void measure_videos(Context& context, const std::vector<synth::PlanarPrint>& prints,
                    const TrainedMethods& all) {
  Tally tarsier;
  Tally orb;
  Tally sift;
  std::vector<double> rest;
  for (std::size_t which = 0; which < prints.size(); ++which) {
    synth::VideoOptions options;
    options.exposure = 0.35;
    options.imaging.noise = 4;
    options.seed = context.seed + which;
    const synth::PlanarVideo video = synth::print_video({prints[which]}, options);
    planar::image_targets::TrackState state;
    const std::vector<planar::image_targets::Target> targets = {all.tarsier_targets[which]};
    std::optional<cv::Point2d> last;
    for (int i = 0; i < kVideoSeconds * kFps; ++i) {
      throw_if_stopped(context.stop);
      const double time = i / kFps;
      const cv::Mat image = video.image_at(time);
      const auto truth = video.truth_at(time);
      // A print that is mostly hidden, or has left the image, is not counted.
      const bool counts = !truth.empty() && truth[0].visible >= 0.5;
      double start = thread_cpu_ms();
      const auto seen = planar::image_targets::track(targets, {}, state, image);
      const double ms = thread_cpu_ms() - start;
      if (!counts) continue;
      std::optional<Corners> corners;
      if (!seen.empty()) corners = seen[0].corners;
      tarsier.add(&truth[0], corners, ms);
      if (corners && last && synth::PlanarVideo::is_at_rest(time) &&
          synth::PlanarVideo::is_at_rest(time - 1 / kFps))
        rest.push_back(cv::norm((*corners)[0] - *last));
      last = corners ? std::optional((*corners)[0]) : std::nullopt;
      if (i % 10 != 0) continue;  // these methods do not use the video: every tenth frame suffices
      cv::Mat gray;
      cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
      start = thread_cpu_ms();
      const auto b = all.orb[which].find(gray);
      orb.add(&truth[0], b, thread_cpu_ms() - start);
      start = thread_cpu_ms();
      const auto c = all.sift[which].find(gray);
      sift.add(&truth[0], c, thread_cpu_ms() - start);
    }
  }
  print_row(context, "videos", "tarsier", tarsier,
            {{"rest_px", rounded(upper_quantile(rest, 0.5), 4)}});
  print_row(context, "videos", "ORB+RANSAC", orb);
  print_row(context, "videos", "SIFT+RANSAC", sift);
}

}  // namespace

ExitStatus bench_targets(Context& context, const BenchOptions& options) {
  cv::setNumThreads(1);
  std::vector<synth::PlanarPrint> prints;
  for (const std::string& path : options.inputs) {
    synth::PlanarPrint print;
    print.name = path;
    print.image = read_image(path);
    print.width = kWidth;
    prints.push_back(std::move(print));
  }
  for (int k = 0; options.inputs.empty() && k < 3; ++k)
    prints.push_back(synth::poster_print(k, context.seed));
  for (synth::PlanarPrint& print : prints) print.id = 0;
  const TrainedMethods all = train_all(prints, context.seed);
  if (is_chosen(options, "stills")) measure_stills(context, prints, all);
  if (is_chosen(options, "videos")) measure_videos(context, prints, all);
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
