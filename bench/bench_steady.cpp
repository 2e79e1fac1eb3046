// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/synth/sources.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "bench.h"
#include "verbs/program/sample_images.h"
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

using cartoon::Cartoonizer;
using cartoon::CartoonizerState;
using cartoon::CartoonOptions;
using cartoon::Mode;

constexpr int kFrames = 200;
constexpr int kSettle = 5;  // frames before counting, for the memory of --steady

std::string default_video() {
  const std::string video = sample_image("vtest.avi");
  return std::filesystem::exists(video) ? video : "synth:portrait?size=640x480&noise=3";
}

// The mask (255) of the regions that do not change between two smoothed grey frames, well away from
// moving regions.
cv::Mat still_regions(const cv::Mat& gray, const cv::Mat& earlier) {
  constexpr int kMaxStillDifference = 5;  // grey levels
  cv::Mat difference;
  cv::absdiff(gray, earlier, difference);
  cv::Mat still = difference < kMaxStillDifference;
  cv::erode(still, still, cv::Mat(), cv::Point(-1, -1), 5);
  return still;
}

// Share of the mask pixels in still regions that change from frame to frame.
struct Flicker {
  double still_pixels = 0;
  double flips = 0;
  [[nodiscard]] double share() const { return still_pixels > 0 ? flips / still_pixels : 0; }
};

struct Drawing {
  explicit Drawing(const CartoonOptions& options)
      : cartoonizer(Cartoonizer::load(ModelStore::find(), options)) {}

  Cartoonizer cartoonizer;
  CartoonizerState state;
  cv::Mat last;
  Flicker flicker;

  void add(const Frame& frame, const cv::Mat& still, bool counts) {
    cv::Mat mask;
    cv::extractChannel(cartoonizer.process(frame, state).image, mask, 0);
    if (!last.empty() && counts) {
      flicker.still_pixels += cv::countNonZero(still);
      flicker.flips += cv::countNonZero((mask != last) & still);
    }
    last = mask;
  }
};

}  // namespace

ExitStatus bench_steady(Context& context, const BenchOptions& options) {
  const std::string input = options.inputs.empty() ? default_video() : options.inputs.front();
  if (!context.json) {
    fmt::print("{}: line pixels that flip from frame to frame where the image stands still\n\n",
               input);
    fmt::print("{:<12} {:>8} {:>10} {:>10} {:>8}\n", "mode", "frames", "plain", "--steady",
               "ratio");
  }
  for (const Mode mode : {Mode::kSketch, Mode::kEvilSketch}) {
    SourceOptions source_options;
    source_options.sequence = true;
    const std::unique_ptr<FrameSource> source =
        open_sources({input}, source_options, {synth::synth_scheme()});
    CartoonOptions cartoon_options;
    cartoon_options.mode = mode;
    Drawing plain(cartoon_options);
    cartoon_options.steady.on = true;
    Drawing steady(cartoon_options);
    cv::Mat earlier;
    int frames = 0;
    while (frames < kFrames && !source->ended()) {
      throw_if_stopped(context.stop);
      const std::optional<Frame> frame = source->next(std::chrono::seconds(10), context.stop);
      if (!frame) break;
      cv::Mat gray;
      cv::cvtColor(frame->image, gray, cv::COLOR_BGR2GRAY);
      cv::GaussianBlur(gray, gray, cv::Size(9, 9), 0);
      const cv::Mat still = earlier.empty() ? cv::Mat() : still_regions(gray, earlier);
      const bool counts = frames > kSettle && !still.empty();
      plain.add(*frame, still, counts);
      steady.add(*frame, still, counts);
      earlier = gray;
      ++frames;
    }
    if (plain.flicker.still_pixels == 0) throw InputError(input, "too few frames to see flicker");
    const double before = plain.flicker.share();
    const double after = steady.flicker.share();
    const double ratio = before > 0 ? after / before : 0;
    if (context.json) {
      print_json(nlohmann::json{{"bench", "steady"},
                                {"case", name_of(mode)},
                                {"mode", name_of(mode)},
                                {"frames", frames},
                                {"plain", before},
                                {"steady", after},
                                {"ratio", ratio}});
    } else {
      fmt::print("{:<12} {:>8} {:>9.3f}% {:>9.3f}% {:>8.3f}\n", name_of(mode), frames, 100 * before,
                 100 * after, ratio);
    }
  }
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
