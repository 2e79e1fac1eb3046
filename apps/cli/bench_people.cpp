// SPDX-License-Identifier: MIT
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/recognition/recognizer.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "bench.h"
#include "cli.h"
#include "people_engine.h"
#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

using recognition::Recognizer;

// Random textures, one for each person, with noise in each picture.
cv::Mat random_face(int person, int picture) {
  const auto texture = [](Rng rng, double sigma) {
    cv::Mat noise(160, 128, CV_32FC1);
    for (int y = 0; y < noise.rows; ++y)
      for (int x = 0; x < noise.cols; ++x)
        noise.at<float>(y, x) = static_cast<float>(rng.normal(0, 12 * sigma));
    cv::GaussianBlur(noise, noise, {}, sigma);
    return noise;
  };
  const cv::Mat own = texture(Rng(7).fork(static_cast<std::uint64_t>(person)), 5);
  const cv::Mat other =
      texture(Rng(8).fork(static_cast<std::uint64_t>(1000 * person + picture)), 5);
  cv::Mat sum = 128 + 2 * own + 0.7 * other;
  sum.convertTo(sum, CV_8U);
  return sum;
}

// Fills the gallery up with random templates.
void fill(Recognizer& model, int templates, int people) {
  Rng rng(3);
  const Eigen::Index length = model.template_length();
  model.templates.resize(templates, length);
  model.people.resize(static_cast<std::size_t>(templates));
  model.labels.clear();
  for (int p = 0; p < people; ++p) model.labels.push_back(fmt::format("p{}", p));
  for (int i = 0; i < templates; ++i) {
    for (Eigen::Index k = 0; k < length; ++k)
      model.templates(i, k) = static_cast<float>(rng.normal());
    model.templates.row(i).normalize();
    model.people[static_cast<std::size_t>(i)] = i % people;
  }
  model.refresh();
}

}  // namespace

// Random faces; one thread.
ExitStatus bench_people(Context& context, const BenchOptions& options) {
  cv::setNumThreads(1);
  using Clock = std::chrono::steady_clock;
  const auto report = [&](const std::string& name, std::vector<double> times) {
    std::sort(times.begin(), times.end());
    const double ms = times[times.size() / 2];
    if (context.json) {
      const nlohmann::ordered_json line = {
          {"bench", "people"}, {"case", name}, {"ms", std::round(ms * 1000) / 1000}};
      print_json_line(line.dump());
    } else {
      print_text(fmt::format("{:<44}{:>10.3f} ms\n", name, ms));
    }
  };
  const auto times = [&](int repeats, const auto& run) {
    std::vector<double> out;
    for (int i = 0; i <= repeats; ++i) {
      throw_if_stopped(context.stop);
      const auto start = Clock::now();
      run();
      if (i > 0 || repeats == 0)
        out.push_back(std::chrono::duration<double, std::milli>(Clock::now() - start).count());
    }
    return out;
  };
  std::vector<cv::Mat> faces;
  std::vector<std::string> labels;
  for (int p = 0; p < 20; ++p) {
    for (int k = 0; k < 10; ++k) {
      faces.push_back(random_face(p, k));
      labels.push_back(fmt::format("p{}", p));
    }
  }
  NoProgress progress;
  Recognizer model;
  const auto background = find_background({});
  report("train 20 people x 10",
         times(1, [&] { model = recognition::train(faces, labels, {}, progress, context.stop); }));
  if (background) {
    report("train 20 people x 10, with the background", times(1, [&] {
             model = recognition::train(faces, labels, {}, progress, context.stop, &*background);
           }));
  }
  fill(model, 1000, 100);
  const cv::Mat probe = random_face(3, 77);
  report("name an aligned face, 1000 templates",
         times(options.repeats, [&] { (void)recognition::identify(model, probe); }));
  fill(model, 100'000, 10'000);
  const std::vector<float> features = recognition::template_of(model, probe);
  report("search 100 000 templates",
         times(options.repeats, [&] { (void)recognition::identify_template(model, features); }));
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
