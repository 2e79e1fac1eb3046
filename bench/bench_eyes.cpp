// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/frame_source.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "bench.h"
#include "framework/stopwatch.h"
#include "verbs/landmarks/engine.h"
#include "verbs/people/engine.h"
#include "verbs/program/sample_images.h"
#include <chrono>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
// How often each method finds both eyes, relative to all images and to images with a detected face,
// and the time for the eyes without face detection. One thread.
ExitStatus bench_eyes(Context& context, const BenchOptions& options) {
  cv::setNumThreads(1);
  const std::vector<std::string> inputs = options.inputs.empty()
                                              ? std::vector<std::string>{sample_image("messi5.jpg")}
                                              : options.inputs;
  std::vector<cv::Mat> images;
  const auto source = open_sources(inputs);
  while (!source->ended()) {
    throw_if_stopped(context.stop);
    const auto frame = source->next(std::chrono::milliseconds(200), context.stop);
    if (!frame) continue;
    cv::Mat gray;
    cv::cvtColor(frame->image, gray, cv::COLOR_BGR2GRAY);
    images.push_back(gray);
  }
  if (images.empty()) throw InputError(inputs.front(), "no image came from it");
  if (!context.json)
    print_text(fmt::format("{:<11}{:>9}{:>14}{:>16}{:>12}\n", "eyes by", "images", "face found",
                           "both eyes found", "ms a face"));
  for (const char* name : {"landmarks", "cascades", "2splits"}) {
    PeopleFlags flags;
    flags.eyes = name;
    face::people::FaceReader reader = make_face_reader(flags);
    face::landmarks::FaceFinder finder = make_face_finder(reader.options().finder);
    int found = 0;
    int both = 0;
    double spent = 0;
    for (const cv::Mat& gray : images) {
      throw_if_stopped(context.stop);
      const Stopwatch watch;
      const bool face = !finder.find(gray).empty();
      const double finding = watch.ms();
      found += face ? 1 : 0;
      const Stopwatch all_watch;
      both += reader.read(gray).empty() ? 0 : 1;
      const double all = all_watch.ms();
      if (face) spent += std::max(0.0, all - finding);
    }
    const auto count = static_cast<double>(images.size());
    const double ms = found > 0 ? spent / found : 0;
    if (context.json) {
      const nlohmann::ordered_json line = {{"bench", "eyes"},           {"case", name},
                                           {"images", images.size()},   {"faces", found / count},
                                           {"both_eyes", both / count}, {"ms", rounded(ms, 3)}};
      print_json(line);
    } else {
      print_text(fmt::format("{:<11}{:>9}{:>12.1f} %{:>14.1f} %{:>12.2f}\n", name, images.size(),
                             100 * found / count, 100 * both / count, ms));
    }
  }
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
