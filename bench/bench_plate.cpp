// SPDX-License-Identifier: MIT
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/core/timer.h"
#include "tarsier/media/image_file.h"
#include "tarsier/synth/sources.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "bench.h"
#include "framework/size_flag.h"
#include "verbs/plate/engine.h"
#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

// A few images, all of the given size.
std::vector<cv::Mat> plate_images(const BenchOptions& options, cv::Size size, std::uint64_t seed) {
  std::vector<cv::Mat> result;
  for (const std::string& path : options.inputs) {
    cv::Mat image;
    cv::resize(read_image(path), image, size, 0, 0, cv::INTER_AREA);
    result.push_back(image);
  }
  if (!result.empty()) return result;
  const auto source = synth::open_synth_source(
      fmt::format("car?size={}x{}&frames=5&seed={}", size.width, size.height, seed));
  while (auto frame = source->next(std::chrono::milliseconds(1000), {}))
    result.push_back(frame->image);
  return result;
}

}  // namespace

ExitStatus bench_plate(Context& context, const BenchOptions& options) {
  const plate::Reader reader = load_reader({}, context);
  std::vector<std::string> sizes = options.sizes;
  if (sizes.empty()) sizes = {"640x480", "1280x720", "1600x1200"};
  if (!context.json)
    print_text(fmt::format("{:>10} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7}\n", "size", "find ms",
                           "align ms", "read ms", "all ms", "frames/s", "plates"));
  for (const std::string& text : sizes) {
    const std::vector<cv::Mat> images =
        plate_images(options, parse_size(text, 16, 10000), context.seed);
    Timers timers;
    std::vector<double> times;
    std::size_t plates = 0;
    Frame frame;
    frame.still = true;
    frame.image = images[0];
    (void)reader.process(frame);
    for (int run = 0; run < options.repeats; ++run) {
      throw_if_stopped(context.stop);
      frame.image = images[static_cast<std::size_t>(run) % images.size()];
      const plate::ReaderResult result = reader.process(frame, nullptr, &timers);
      plates += result.plates.size();
      times.push_back(result.ms);
    }
    const double all = upper_median(times);
    nlohmann::ordered_json line{{"bench", "plate"}, {"case", text}, {"threads", context.threads}};
    std::vector<double> stages;
    for (const TimerStats& stats : timers.stats()) {
      stages.push_back(stats.average_ms());
      line[stats.name + "_ms"] = rounded(stats.average_ms(), 2);
    }
    stages.resize(3);
    line["ms"] = rounded(all, 2);
    line["fps"] = std::round(1e4 / all) / 10;
    line["plates"] = static_cast<double>(plates) / options.repeats;
    if (context.json)
      print_json(line);
    else
      print_text(fmt::format("{:>10} {:>8.1f} {:>8.1f} {:>8.1f} {:>8.1f} {:>8.1f} {:>7.1f}\n", text,
                             stages[0], stages[1], stages[2], all, 1000 / all,
                             static_cast<double>(plates) / options.repeats));
  }
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
