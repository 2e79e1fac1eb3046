// SPDX-License-Identifier: MIT
#include "bench_people.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/appearance/synthesis.h"
#include "tarsier/face/people/eyes.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/model.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/normalize.h"
#include "tarsier/face/recognition/recognizer.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "bench.h"
#include "scratch.h"
#include "verbs/aam/engine.h"
#include "verbs/people/engine.h"
#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>

namespace tarsier::cli {
namespace {

using face::recognition::Recognizer;
using Clock = std::chrono::steady_clock;

constexpr int kImages = 5;             // per person
constexpr std::int64_t kSize = 5000;   // faces of the gallery, unless --size is given
constexpr int kStranger = 10'000'000;  // number of the first person who is not enrolled

// Wall clock and processor time; on a busy machine the latter is more reliable.
struct Took {
  double ms = 0;
  double cpu_ms = 0;
};

class Watch {
 public:
  [[nodiscard]] Took took() const {
    return {std::chrono::duration<double, std::milli>(Clock::now() - start_).count(),
            1e3 * static_cast<double>(std::clock() - cpu_) / CLOCKS_PER_SEC};
  }

 private:
  Clock::time_point start_ = Clock::now();
  std::clock_t cpu_ = std::clock();
};

// Synthetic faces of the shipped appearance model with random parameters, one person per number.
// They are cropped as by crop_face(). Images of one person differ in light, position and noise.
class DrawnPeople {
 public:
  explicit DrawnPeople(const face::appearance::AppearanceModel& model)
      : model_(&model), synthesis_(model) {}

  [[nodiscard]] std::vector<cv::Mat> images(int person, int first, int count) const {
    const auto seed = static_cast<std::uint64_t>(person);
    const auto face = face::appearance::random_face(*model_, synthesis_.texture(), seed + 1);
    Eigen::Matrix2Xd points;
    const cv::Mat portrait = synthesis_.portrait(face.b, face.c, {230, 270}, &points);
    cv::Mat gray;
    cv::cvtColor(portrait, gray, cv::COLOR_BGR2GRAY);
    const cv::Mat crop = face::people::crop_face(gray, face::people::eyes_from_landmarks(points));
    std::vector<cv::Mat> out;
    for (int k = first; k < first + count; ++k) {
      Rng rng = Rng(seed + 1).fork(static_cast<std::uint64_t>(k));
      const double dx = 2 * rng.normal();
      const double dy = 2 * rng.normal();
      const double degrees = 2 * rng.normal();
      const double growth = 1 + 0.02 * rng.normal();
      out.push_back(face::recognition::relit_face(
          face::recognition::transformed_face(crop, dx, dy, degrees, growth), 0.6, rng()));
    }
    return out;
  }

 private:
  const face::appearance::AppearanceModel* model_;
  face::appearance::Synthesis synthesis_;
};

class PeopleBench {
 public:
  PeopleBench(Context& context, const BenchOptions& options)
      : context_(context),
        options_(options),
        model_(face::appearance::read_appearance_model(shipped_appearance_model())),
        drawn_(model_) {
    const auto background = find_background({});
    if (!background) throw InputError("people-background.json", "is needed");
    background_ = *background;
  }

  void small() {
    std::vector<cv::Mat> faces;
    std::vector<std::string> labels;
    for (int p = 0; p < 20; ++p) {
      for (cv::Mat& face : drawn_.images(kStranger + p, 0, 10)) {
        faces.push_back(std::move(face));
        labels.push_back(fmt::format("p{}", p));
      }
    }
    NoProgress quiet;
    report("train 20 people x 10", times(1, [&] {
             (void)face::recognition::train(faces, labels, {}, quiet, context_.stop);
           }));
    Recognizer model;
    report("train 20 people x 10, with the background", times(1, [&] {
             model =
                 face::recognition::train(faces, labels, {}, quiet, context_.stop, &background_);
           }));
    report("name an aligned face, 200 templates",
           times(options_.repeats, [&] { (void)face::recognition::identify(model, faces[37]); }));
  }

  // Measures a gallery with `size` enrolled faces.
  void gallery(std::int64_t size) {
    const std::string name = fmt::format("{} faces: ", size);
    const Scratch scratch;
    face::people::Gallery gallery(scratch / "people.db");
    face::people::TemplateExtractor maker(gallery, &background_);
    const std::int64_t alone = std::min<std::int64_t>(1000, std::max<std::int64_t>(1, size / 5));
    fill(gallery, size - alone);
    // The last ones are enrolled as by a user: one after the other, each on the disk before the
    // next. Face detection is not included: the faces are aligned already.
    std::vector<Took> each;
    context_.progress->begin("one by one", alone, "faces");
    each_face(size - alone, size, [&](face::people::NewFace&& entry) {
      throw_if_stopped(context_.stop);
      const Watch watch;
      maker.fill(entry.face);
      gallery.enroll(entry.name, entry.note, entry.face);
      each.push_back(watch.took());
      context_.progress->advance();
    });
    context_.progress->end();
    report(name + "enrol one more", each);

    Watch watch;
    auto model = face::people::load_gallery_model(gallery, &background_, true,
                                                  face::people::TrainingPolicy::kAlways,
                                                  *context_.progress, context_.stop);
    report(name + "learn again (train)", {watch.took()});
    model.reset();
    watch = {};
    model = face::people::load_gallery_model(gallery, &background_, true,
                                             face::people::TrainingPolicy::kIfNeeded,
                                             *context_.progress, context_.stop);
    report(name + "read the model and all templates", {watch.took()});
    const Recognizer& recognizer = model->recognizer;
    std::vector<cv::Mat> probes;
    for (int k = 0; k < std::max(2, options_.repeats); ++k)
      probes.push_back(drawn_.images(person_of(size, k), kImages, 1).front());
    std::vector<Took> named;
    for (const cv::Mat& probe : probes) {
      watch = {};
      (void)face::people::recognize(recognizer, face::recognition::template_of(recognizer, probe),
                                    0.01);
      named.push_back(watch.took());
    }
    report(name + "name an aligned face", named);
    judge(name, size, recognizer);

    face::people::GalleryFollower follower(gallery, &background_, std::move(model));
    (void)follower.update();
    report(name + "look whether the gallery changed",
           times(options_.repeats, [&] { (void)follower.update(); }));
    const std::string someone = gallery.people()[static_cast<std::size_t>(size / kImages / 2)].name;
    watch = {};
    const auto forgotten = gallery.forget(someone, context_.stop);
    report(name + "forget a person, with the proof", {watch.took()});
    watch = {};
    (void)follower.update();
    report(name + "notice it in a running program", {watch.took()});
    std::error_code ignored;
    line({{"bench", "people"},
          {"case", name + "in all"},
          {"proven", forgotten && forgotten->proven()},
          {"pieces", forgotten ? forgotten->total_pieces : 0},
          {"file_mb",
           rounded(static_cast<double>(std::filesystem::file_size(scratch / "people.db", ignored)) /
                       1e6,
                   3)},
          {"memory_mb", rounded(peak_memory(), 3)}});
  }

 private:
  void line(const nlohmann::ordered_json& object) const {
    if (context_.json) return print_json(object);
    std::string text;
    for (const auto& [key, value] : object.items())
      if (key != "bench" && key != "case") text += fmt::format("  {} {}", key, value.dump());
    print_text(fmt::format("{:<52}{}\n", object["case"].get<std::string>(), text));
  }

  void report(const std::string& name, std::vector<Took> times) const {
    double cpu = 0;
    for (const Took& one : times) cpu += one.cpu_ms / static_cast<double>(times.size());
    std::sort(times.begin(), times.end(), [](const Took& a, const Took& b) { return a.ms < b.ms; });
    nlohmann::ordered_json object = {{"bench", "people"},
                                     {"case", name},
                                     {"ms", rounded(times[times.size() / 2].ms, 3)},
                                     {"mean_cpu_ms", rounded(cpu, 3)}};
    if (times.size() >= 20) object["p95"] = rounded(times[times.size() * 95 / 100].ms, 3);
    line(object);
  }

  template <typename Run>
  std::vector<Took> times(int repeats, const Run& run) const {
    std::vector<Took> out;
    for (int i = 0; i <= repeats; ++i) {
      throw_if_stopped(context_.stop);
      const Watch watch;
      run();
      if (i > 0 || repeats == 0) out.push_back(watch.took());
    }
    return out;
  }

  static int person_of(std::int64_t size, int k) {
    return static_cast<int>((k * 7919LL) % (size / kImages));
  }

  template <typename Take>
  void each_face(std::int64_t from, std::int64_t to, const Take& take) const {
    for (std::int64_t i = from; i < to;) {
      const auto person = static_cast<int>(i / kImages);
      const auto first = static_cast<int>(i % kImages);
      const auto count = static_cast<int>(std::min<std::int64_t>(kImages - first, to - i));
      for (cv::Mat& image : drawn_.images(person, first, count)) {
        face::people::NewFace entry;
        entry.name = fmt::format("p{}", person);
        entry.face.crop = std::move(image);
        entry.face.quality = 0.5;
        entry.face.measures = "{}";
        entry.face.source = "drawn";
        entry.face.time = i;
        take(std::move(entry));
      }
      i += count;
    }
  }

  // Adds the first `count` faces, some hundreds per transaction, with coordinates computed in
  // advance, so that the last ones can be measured without waiting for days.
  void fill(face::people::Gallery& gallery, std::int64_t count) const {
    constexpr std::int64_t kBatch = 50LL * kImages;
    const std::int64_t space = -face::recognition::fingerprint(background_);
    context_.progress->begin("enrolling", count, "faces");
    for (std::int64_t first = 0; first < count; first += kBatch) {
      throw_if_stopped(context_.stop);
      const std::int64_t last = std::min(count, first + kBatch);
      std::vector<face::people::NewFace> batch(static_cast<std::size_t>(last - first));
      const auto people = static_cast<int>((last - first + kImages - 1) / kImages);
      cv::parallel_for_({0, people}, [&](const cv::Range& range) {
        for (int p = range.start; p < range.end; ++p) {
          auto at = static_cast<std::size_t>(p) * kImages;
          each_face(first + p * kImages, std::min<std::int64_t>(last, first + (p + 1) * kImages),
                    [&](face::people::NewFace&& entry) {
                      entry.face.features =
                          face::recognition::coordinates_of(background_, entry.face.crop);
                      entry.face.space = space;
                      batch[at++] = std::move(entry);
                    });
        }
      });
      gallery.enroll(batch);
      context_.progress->advance(last - first);
    }
    context_.progress->end();
  }

  // Probes: other images of enrolled people, and images of people who are not enrolled.
  void judge(const std::string& name, std::int64_t size, const Recognizer& recognizer) const {
    constexpr int kProbes = 200;
    int right = 0;
    int known = 0;
    int accepted = 0;
    for (int k = 0; k < kProbes; ++k) {
      throw_if_stopped(context_.stop);
      const int person = person_of(size, k);
      const auto seen = face::people::recognize(
          recognizer,
          face::recognition::template_of(recognizer, drawn_.images(person, kImages, 1).front()),
          0.01);
      const bool same = seen.label == fmt::format("p{}", person);
      if (same) ++right;
      if (same && seen.known) ++known;
      const auto stranger = face::people::recognize(
          recognizer,
          face::recognition::template_of(recognizer, drawn_.images(kStranger + k, 0, 1).front()),
          0.01);
      if (stranger.known) ++accepted;
    }
    line({{"bench", "people"},
          {"case", name + "of 200 people, 200 strangers, at a rate of 0.01"},
          {"nearest_right", right},
          {"known", known},
          {"strangers_accepted", accepted}});
  }

  Context& context_;
  const BenchOptions& options_;
  face::appearance::AppearanceModel model_;
  DrawnPeople drawn_;
  face::recognition::Background background_;
};

std::int64_t faces_of(const std::string& text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() ||
      value <= face::people::kMaxSmallGalleryFaces || value > 10'000'000)
    throw UsageError(fmt::format("--size {}: for people a number of faces from {} to 10000000",
                                 text, face::people::kMaxSmallGalleryFaces + 1));
  return value;
}

// Whether the text is --size templates:N or templates:N:SPREAD, indexed:N or indexed:N:SPREAD.
bool is_of_templates(const std::string& text) {
  return text.starts_with("templates:") || text.starts_with("indexed:");
}

void bench_templates(Context& context, const std::string& text) {
  const std::string rest = text.substr(text.find(':') + 1);
  const std::size_t colon = rest.find(':');
  double spread = 1;
  if (colon != std::string::npos) {
    const std::string number = rest.substr(colon + 1);
    const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), spread);
    if (error != std::errc() || end != number.data() + number.size() || !(spread > 0) ||
        spread > 100)
      throw UsageError(fmt::format("--size {}: templates:N:SPREAD or indexed:N:SPREAD", text));
  }
  const std::int64_t count = faces_of(rest.substr(0, colon));
  const auto background = find_background({});
  if (!background) throw InputError("people-background.json", "is needed");
  const Scratch scratch;
  (text.starts_with("indexed:") ? bench_indexed_gallery : bench_template_index)(
      context, *background, count, spread, scratch / "");
}

}  // namespace

double peak_memory() {
  std::ifstream status("/proc/self/status");
  std::string line;
  while (std::getline(status, line))
    if (line.starts_with("VmHWM:")) return std::atof(line.c_str() + 6) / 1024;
  return 0;
}

// Synthetic faces. --size: faces of the gallery; templates:N: N random templates in an index;
// indexed:N: in a gallery with an index.
ExitStatus bench_people(Context& context, const BenchOptions& options) {
  std::vector<std::int64_t> sizes;
  bool any = false;
  for (const std::string& text : options.sizes) {
    if (is_of_templates(text)) {
      bench_templates(context, text);
      any = true;
    } else {
      sizes.push_back(faces_of(text));
    }
  }
  if (any && sizes.empty()) return ExitStatus::kDone;
  PeopleBench bench(context, options);
  if (sizes.empty()) {
    bench.small();
    sizes = {kSize};
  }
  for (const std::int64_t size : sizes) bench.gallery(size);
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
