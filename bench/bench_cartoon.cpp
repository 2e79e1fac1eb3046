// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/cartoon/reference.h"
#include "tarsier/core/cpu.h"
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/core/timer.h"
#include "tarsier/media/image_file.h"
#include "tarsier/synth/portrait.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "bench.h"
#include "framework/size_flag.h"
#include "framework/stopwatch.h"
#include "measure.h"
#include "verbs/program/sample_images.h"
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

namespace tarsier::cli {
namespace {

using cartoon::Cartoonizer;
using cartoon::CartoonizerState;
using cartoon::CartoonOptions;
using cartoon::Mode;

constexpr double kIdenticalPsnr = 99;  // dB, used for identical images

// Similarity of two images of any size and type.
struct Likeness {
  std::optional<double> psnr;          // of the painting, dB
  std::optional<double> ssim;          // of the painting
  std::optional<double> iou;           // of the line pixels
  double image_psnr = kIdenticalPsnr;  // of the finished image, dB
};

double psnr(const cv::Mat& a, const cv::Mat& b) { return std::min(kIdenticalPsnr, cv::PSNR(a, b)); }

// Mean structural similarity over all channels (Wang et al., IEEE TIP 2004: Gaussian window of
// sigma 1.5).
double ssim(const cv::Mat& a8, const cv::Mat& b8) {
  const double c1 = std::pow(0.01 * 255, 2);
  const double c2 = std::pow(0.03 * 255, 2);
  const auto smooth = [](const cv::Mat& m) {
    cv::Mat result;
    cv::GaussianBlur(m, result, cv::Size(11, 11), 1.5);
    return result;
  };
  cv::Mat a;
  cv::Mat b;
  a8.convertTo(a, CV_32F);
  b8.convertTo(b, CV_32F);
  const cv::Mat mean_a = smooth(a);
  const cv::Mat mean_b = smooth(b);
  const cv::Mat var_a = smooth(a.mul(a)) - mean_a.mul(mean_a);
  const cv::Mat var_b = smooth(b.mul(b)) - mean_b.mul(mean_b);
  const cv::Mat both = smooth(a.mul(b)) - mean_a.mul(mean_b);
  cv::Mat above =
      (2 * mean_a.mul(mean_b) + cv::Scalar::all(c1)).mul(2 * both + cv::Scalar::all(c2));
  cv::Mat below = (mean_a.mul(mean_a) + mean_b.mul(mean_b) + cv::Scalar::all(c1))
                      .mul(var_a + var_b + cv::Scalar::all(c2));
  cv::Mat map;
  cv::divide(above, below, map);
  const cv::Scalar mean = cv::mean(map);
  return (mean[0] + mean[1] + mean[2]) / 3;
}

// Intersection over union of the black pixels of two line drawings.
double line_iou(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat gray_a;
  cv::Mat gray_b;
  cv::extractChannel(a, gray_a, 0);
  cv::extractChannel(b, gray_b, 0);
  const double both = cv::countNonZero((gray_a == 0) & (gray_b == 0));
  const double either = cv::countNonZero((gray_a == 0) | (gray_b == 0));
  return either > 0 ? both / either : 1;
}

Frame frame_of(const cv::Mat& image) {
  Frame frame;
  frame.image = image;
  return frame;
}

bool has_painting(Mode mode) {
  return mode == Mode::kPaint || mode == Mode::kCartoon || mode == Mode::kEvil ||
         mode == Mode::kAlien;
}
// The mode of the lines alone; nullopt if the mode draws no lines.
std::optional<Mode> lines_of(Mode mode) {
  if (mode == Mode::kSketch || mode == Mode::kCartoon || mode == Mode::kAlien) return Mode::kSketch;
  if (mode == Mode::kEvil || mode == Mode::kEvilSketch) return Mode::kEvilSketch;
  return std::nullopt;
}

Likeness likeness(const cv::Mat& frame, Mode mode) {
  const auto fast_and_reference = [&](Mode m) {
    CartoonOptions options;
    options.mode = m;
    CartoonizerState state;
    return std::pair(
        Cartoonizer::load(ModelStore::find(), options).process(frame_of(frame), state).image,
        cartoon::reference::cartoonize(frame, options));
  };
  Likeness result;
  if (has_painting(mode)) {
    const auto [fast, reference] = fast_and_reference(Mode::kPaint);
    result.psnr = psnr(fast, reference);
    result.ssim = ssim(fast, reference);
  }
  if (const std::optional<Mode> lines = lines_of(mode)) {
    const auto [fast, reference] = fast_and_reference(*lines);
    result.iou = line_iou(fast, reference);
  }
  const auto [fast, reference] = fast_and_reference(mode);
  result.image_psnr = psnr(fast, reference);
  return result;
}

void keep_minimum(std::optional<double>& minimum, const std::optional<double>& value) {
  if (value) minimum = minimum ? std::min(*minimum, *value) : *value;
}

struct Cost {
  double wall_ms = 0;
  double cpu_ms = 0;  // sum of all threads
};

// Medians of `runs` runs of work() for each number of threads, in turn, so that other load affects
// all of them equally. Each measured run follows one unmeasured run, because after a change of the
// number of threads some are asleep.
template <typename Work>
std::map<int, Cost> costs(int runs, const std::set<int>& thread_counts, const std::stop_token& stop,
                          const Work& work) {
  std::map<int, std::vector<double>> wall;
  std::map<int, std::vector<double>> cpu;
  for (int i = 0; i < runs; ++i) {
    for (const int threads : thread_counts) {
      throw_if_stopped(stop);
      cv::setNumThreads(threads);
      work();
      const double cpu_before = process_cpu_ms();
      const Stopwatch watch;
      work();
      wall[threads].push_back(watch.ms());
      cpu[threads].push_back(process_cpu_ms() - cpu_before);
    }
  }
  std::map<int, Cost> result;
  for (const int threads : thread_counts) {
    result[threads] = {upper_median(wall[threads]), upper_median(cpu[threads])};
  }
  return result;
}

std::string processor_name() {
  std::ifstream file("/proc/cpuinfo");
  std::string line;
  while (std::getline(file, line)) {
    const size_t colon = line.find(": ");
    if (line.starts_with("model name") && colon != std::string::npos) return line.substr(colon + 2);
  }
  return "unknown processor";
}

// Number of runnable processes, averaged by the system over a minute; this process is included.
std::optional<double> load_average() {
  double load = 0;
  if (getloadavg(&load, 1) != 1) return std::nullopt;
  return load;
}

std::vector<cv::Mat> images(const std::vector<std::string>& inputs, cv::Size size) {
  std::vector<cv::Mat> result;
  const auto add = [&](const cv::Mat& image) {
    cv::Mat frame;
    cv::resize(image, frame, size, 0, 0,
               image.cols > size.width ? cv::INTER_AREA : cv::INTER_CUBIC);
    result.push_back(frame);
  };
  for (const std::string& input : inputs) add(read_image(input));
  if (!result.empty()) return result;
  for (const char* name : {"home.jpg", "messi5.jpg", "building.jpg"}) {
    const std::string path = sample_image(name);
    if (std::filesystem::exists(path)) add(read_image(path));
  }
  result.push_back(synth::render_portrait(size).image);
  return result;
}

nlohmann::json optional_number(const std::optional<double>& value) {
  return value ? nlohmann::json(*value) : nlohmann::json(nullptr);
}
std::string cell(const std::optional<double>& value, int digits) {
  return value ? fmt::format("{:.{}f}", *value, digits) : "-";
}

// Time of each stage of a frame, in ms of wall clock: the fastest of the runs, averaged over the
// images.
void print_stages(Context& context, const BenchOptions& options, const std::vector<cv::Mat>& frames,
                  Mode mode, const std::string& size_name, const std::set<int>& thread_counts) {
  CartoonOptions cartoon_options;
  cartoon_options.mode = mode;
  const auto cartoonizer = Cartoonizer::load(ModelStore::find(), cartoon_options);
  for (const int threads : thread_counts) {
    cv::setNumThreads(threads);
    std::vector<std::pair<std::string, double>> stages;
    for (const cv::Mat& image : frames) {
      const Frame frame = frame_of(image);
      CartoonizerState state;
      (void)cartoonizer.process(frame, state);
      Timers timers;
      for (int i = 0; i < options.repeats; ++i) {
        throw_if_stopped(context.stop);
        (void)cartoonizer.process(frame, state, nullptr, &timers);
      }
      for (const TimerStats& stats : timers.stats()) {
        const auto at = std::find_if(stages.begin(), stages.end(),
                                     [&](const auto& stage) { return stage.first == stats.name; });
        auto& stage = at != stages.end() ? *at : stages.emplace_back(stats.name, 0.0);
        stage.second += stats.min_ms / static_cast<double>(frames.size());
      }
    }
    for (const auto& [name, ms] : stages) {
      if (context.json) {
        print_json(nlohmann::json{
            {"bench", "cartoon"},
            {"case", fmt::format("{} {}, {} threads: {}", name_of(mode), size_name, threads, name)},
            {"size", size_name},
            {"mode", name_of(mode)},
            {"threads", threads},
            {"stage", name},
            {"ms", ms},
            {"simd", name_of(simd_level())},
            {"processor", processor_name()}});
      } else {
        fmt::print("{:<10} {:<12} {:>7} {:<20} {:>8.3f}\n", size_name, name_of(mode), threads, name,
                   ms);
      }
    }
  }
}

}  // namespace

ExitStatus bench_cartoon(Context& context, const BenchOptions& options) {
  std::vector<cv::Size> sizes;
  for (const std::string& text : options.sizes) sizes.push_back(parse_size(text, 16, 10000));
  if (sizes.empty()) sizes = {{320, 240}, {640, 480}, {1920, 1080}};
  std::vector<Mode> modes;
  for (const std::string& name : options.only) modes.push_back(cartoon::parse_mode(name));
  if (modes.empty()) modes = cartoon::all_modes();
  std::set<int> thread_counts{1, std::min(2, cv::getNumberOfCPUs())};
  if (context.threads > 0) thread_counts = {context.threads};

  const std::string processor = processor_name();
  const std::optional<double> load = load_average();
  if (!context.json) {
    fmt::print(
        "{}, {} processors, {}, load {}; times in ms, {} of {} runs, averaged over the "
        "images{}.\n\n",
        processor, cv::getNumberOfCPUs(), name_of(simd_level()), cell(load, 2),
        options.stages ? "the fastest" : "the median", options.repeats,
        options.stages ? "" : "; cpu: of all threads; likeness: the worst");
    if (options.stages) {
      fmt::print("{:<10} {:<12} {:>7} {:<20} {:>8}\n", "size", "mode", "threads", "stage",
                 "fastest");
    } else {
      fmt::print("{:<10} {:<12} {:>7} {:>10} {:>8} {:>8} {:>7} {:>8} {:>7} {:>7} {:>7} {:>7}\n",
                 "size", "mode", "threads", "reference", "fast", "cpu", "ratio", "frames/s",
                 "scaling", "PSNR", "SSIM", "IoU");
    }
  }
  const int threads_before = cv::getNumThreads();
  for (const cv::Size& size : sizes) {
    const std::vector<cv::Mat> frames = images(options.inputs, size);
    const std::string size_name = fmt::format("{}x{}", size.width, size.height);
    for (const Mode mode : modes) {
      if (options.stages) {
        print_stages(context, options, frames, mode, size_name, thread_counts);
        continue;
      }
      CartoonOptions cartoon_options;
      cartoon_options.mode = mode;
      const auto cartoonizer = Cartoonizer::load(ModelStore::find(), cartoon_options);
      Likeness worst;
      for (const cv::Mat& frame : frames) {
        const Likeness one = likeness(frame, mode);
        keep_minimum(worst.psnr, one.psnr);
        keep_minimum(worst.ssim, one.ssim);
        keep_minimum(worst.iou, one.iou);
        worst.image_psnr = std::min(worst.image_psnr, one.image_psnr);
      }
      std::map<int, Cost> references;
      std::map<int, Cost> fasts;
      for (const cv::Mat& image : frames) {
        const Frame frame = frame_of(image);
        CartoonizerState state;
        cv::Mat sink;
        const auto add = [](std::map<int, Cost>& sums, const std::map<int, Cost>& more) {
          for (const auto& [threads, cost] : more) {
            sums[threads].wall_ms += cost.wall_ms;
            sums[threads].cpu_ms += cost.cpu_ms;
          }
        };
        add(references, costs(std::max(1, options.repeats / 5), thread_counts, context.stop, [&] {
              sink = cartoon::reference::cartoonize(image, cartoon_options);
            }));
        add(fasts, costs(options.repeats, thread_counts, context.stop,
                         [&] { (void)cartoonizer.process(frame, state); }));
      }
      for (const int threads : thread_counts) {
        const auto count = static_cast<double>(frames.size());
        // A pass-through takes less time than the clock can measure.
        constexpr double kMin_ms = 0.001;
        const double reference_ms = std::max(references[threads].wall_ms / count, kMin_ms);
        const double fast_ms = std::max(fasts[threads].wall_ms / count, kMin_ms);
        const double cpu_ms = fasts[threads].cpu_ms / count;
        const double ratio = reference_ms / fast_ms;
        std::optional<double> scaling;
        if (threads > 1 && fasts.contains(1)) {
          scaling = std::max(fasts[1].wall_ms / count, kMin_ms) / fast_ms;
        }
        if (context.json) {
          print_json(nlohmann::json{
              {"bench", "cartoon"},
              {"case", fmt::format("{} {}, {} threads", name_of(mode), size_name, threads)},
              {"size", size_name},
              {"mode", name_of(mode)},
              {"threads", threads},
              {"reference_ms", reference_ms},
              {"fast_ms", fast_ms},
              {"cpu_ms", cpu_ms},
              {"ratio", ratio},
              {"fps", 1000 / fast_ms},
              {"scaling", optional_number(scaling)},
              {"psnr", optional_number(worst.psnr)},
              {"ssim", optional_number(worst.ssim)},
              {"iou", optional_number(worst.iou)},
              {"image_psnr", worst.image_psnr},
              {"simd", name_of(simd_level())},
              {"processor", processor},
              {"processors", cv::getNumberOfCPUs()},
              {"load", optional_number(load)}});
        } else {
          fmt::print(
              "{:<10} {:<12} {:>7} {:>10.2f} {:>8.2f} {:>8.2f} {:>7.1f} {:>8.0f} {:>7} {:>7} {:>7} "
              "{:>7}\n",
              size_name, name_of(mode), threads, reference_ms, fast_ms, cpu_ms, ratio,
              1000 / fast_ms, cell(scaling, 2), cell(worst.psnr, 1), cell(worst.ssim, 4),
              cell(worst.iou, 4));
          std::fflush(stdout);
        }
      }
    }
  }
  cv::setNumThreads(threads_before);
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
