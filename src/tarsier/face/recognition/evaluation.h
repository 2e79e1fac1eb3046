// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/core/statistics.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// How well recognisers do on a list of labelled faces.
namespace tarsier::face::recognition {

struct LabelledFace {
  std::string path;
  std::string label;
  std::optional<cv::Point2d> left_eye{};  // as seen in the image, px; both or none
  std::optional<cv::Point2d> right_eye{};
};

// Lines `path<TAB>label`, with four more fields the true eyes x y x y of the left and right eye as
// seen. Relative paths are taken from the folder of the list where nothing is there from here.
// Empty lines and those that begin with # do not count. Throws InputError with the line number.
[[nodiscard]] std::vector<LabelledFace> read_face_list(const std::string& path);

struct EvaluationOptions {
  int training = 5;  // images of each person that train
  // In place of `training` random ones: the first so many faces train, all others are probes. 0: none.
  int gallery = 0;
  std::vector<std::uint64_t> seeds{0, 1, 2, 3, 4};  // 1..1000 of them, one random choice each
  // For each face whether it may train; empty: all may. Probes that may not are counted apart.
  std::vector<bool> may_train;
  bool strangers = true;  // once more with some of the people enrolled only
  int enrolled = 0;       // so many of them; 0: half, rounded down
  // Rate at which true accepts are counted with a threshold chosen on the very scores that are
  // judged: how well the scores tell people apart. Nobody has that threshold beforehand.
  double false_accepts = 0.01;
  // The rate that each model's own calibration is asked for: what a user gets.
  double stated_rate = 0.01;

  [[nodiscard]] OptionFields fields() {
    return {{"training", training, range(1, 10'000)},
            {"gallery", gallery, range(0, 10'000'000)},
            {"enrolled", enrolled, range(0, 1'000'000)},
            {"false_accepts", false_accepts, inside(0, 1)},
            {"stated_rate", stated_rate, inside(0, 1)}};
  }
  void check() const;
};

// A choice: who trains and who is asked for. Of each person (labels in sorted order) `training`
// random images train, all others are probes. The choice is that of numpy:
//   r = RandomState(seed); for each person: r.permutation(images)[:training]
//   RandomState(seed + 1000).permutation(people)[:enrolled] are enrolled where some of them are.
// The upper half of the 64 bits of `seed` does not count.
struct Split {
  std::vector<int> training;  // indices into the faces, ascending
  std::vector<int> probes;
};
// Only `enrolled` of the people (at random; 0: all) train; all images of the others are probes.
// `may_train`: as in EvaluationOptions; the choice is among those that may.
[[nodiscard]] Split split_of(const std::vector<std::string>& labels, int training,
                             std::uint64_t seed, int enrolled = 0,
                             const std::vector<bool>& may_train = {});
// The first `gallery` faces train, of so many people at random (as above; 0: of all), the faces
// after them are probes. A gallery of 0 or of all faces leaves one of the two empty.
[[nodiscard]] Split split_of_gallery(const std::vector<std::string>& labels, int gallery,
                                     std::uint64_t seed, int enrolled = 0);
[[nodiscard]] int count_people(const std::vector<std::string>& labels);

// One probe's answer.
struct ProbeResult {
  int face = 0;
  bool known = false;  // whether the person is enrolled
  bool right = false;  // best label
  double score = 0;    // of the best
  int rank = 0;        // of the right person among all, from 1; 0: not enrolled
};

// How often something was so, out of how many times it could have been.
struct Count {
  long hits = 0;
  long trials = 0;
};

// A rate over several random draws from the same images, with its 95 % interval. The draws ask
// much the same questions again, so the interval is that of one draw's number of trials
// (wilson_interval_of_rate). It is about other images of such people; other people and other
// cameras differ by more.
struct Rate {
  Count count;  // of all draws
  int draws = 0;
  double value = -1;  // count.hits / count.trials; -1: nothing was tried
  Interval interval;
};

struct SeedResult {
  std::uint64_t seed = 0;
  int people = 0;
  int training = 0;  // images
  int probes = 0;
  double accuracy = 0;  // best label right, everyone enrolled
  // Some of the people enrolled (`strangers`), else negative:
  double true_accepts = -1;   // share of known probes with a score that at most `false_accepts` of
                              // the strangers reach
  double right_accepts = -1;  // and the right label (DIR)
  double equal_error = -1;    // EER
  double area = -1;           // under the ROC
  double stated_true = -1;    // known probes above the model's own threshold for `stated_rate`
  double stated_right = -1;   // the same, under the right name
  double stated_false = -1;   // strangers above it: to be compared with `stated_rate`
  int known_probes = 0;
  int stranger_probes = 0;
  bool calibrated = false;  // whether the model has a threshold of its own
  // The same as counts.
  Count identified;
  Count true_count;
  Count right_count;
  Count stated_true_count;
  Count stated_right_count;
  Count stated_false_count;
  // The same of probes that may not train (EvaluationOptions::may_train). All other figures, `probes`,
  // `closed` and `open` leave these out.
  Count uncertain_identified;
  Count uncertain_true_count;
  Count uncertain_false_count;
  double train_seconds = 0;
  double identify_ms = 0;  // mean of a probe, describing included
  std::vector<ProbeResult> closed;
  std::vector<ProbeResult> open;
};

struct EvaluationResult {
  Algorithm algorithm = Algorithm::kDefault;
  EvaluationOptions options;
  std::vector<SeedResult> seeds;

  bool with_background = false;

  // Rates and times: means over the seeds; numbers of probes and counts: sums.
  [[nodiscard]] SeedResult mean() const;
  // All seeds together; e.g. rate(&SeedResult::stated_false_count).
  [[nodiscard]] Rate rate(Count SeedResult::*count) const;
};

// Faces: CV_8UC1. `background` as train() takes it: a gallery's recogniser is trained with the one
// that ships, so figures of the product need it. Throws std::invalid_argument where there is nobody
// with more images than `training` or (for strangers) fewer than two people, or nobody left to be
// a stranger; Interrupted.
[[nodiscard]] EvaluationResult evaluate(const std::vector<cv::Mat>& faces,
                                        const std::vector<std::string>& labels,
                                        const RecognizerOptions& recognizer,
                                        const EvaluationOptions& options, Progress& progress,
                                        const std::stop_token& stop,
                                        const Background* background = nullptr);

// Curves over all seeds together.
struct Curve {
  std::vector<double> x;
  std::vector<double> y;
};
// Cumulative match: rank 1.. -> share of closed probes whose person is among the first so many.
[[nodiscard]] Curve match_curve(const EvaluationResult& result);
// False accept rate -> true accept rate, a point for each distinct score.
[[nodiscard]] Curve accept_curve(const EvaluationResult& result);

// Rates from scores: those of the known and of strangers. The threshold is the least score that at
// most `rate` of the strangers reach (score >= threshold).
struct AcceptRates {
  double threshold = 0;
  double true_accepts = 0;
  double equal_error = 0;
  double area = 0;
};
[[nodiscard]] AcceptRates accept_rates(std::vector<double> known, std::vector<double> strangers,
                                       double rate);

// "algorithm,training,seed,people,probes,identified,accuracy,.." with a line for each seed and one
// for all of them ("all" in the place of the seed): counts are summed, rates and times averaged.
// "training" is that of the options; where there is a gallery, its faces.
[[nodiscard]] std::string evaluation_csv(const std::vector<EvaluationResult>& results);
// Plots of all algorithms (CV_8UC3; SVG text).
[[nodiscard]] cv::Mat match_plot(const std::vector<EvaluationResult>& results, cv::Size size);
[[nodiscard]] cv::Mat accept_plot(const std::vector<EvaluationResult>& results, cv::Size size);
[[nodiscard]] std::string match_plot_svg(const std::vector<EvaluationResult>& results,
                                         cv::Size size);
[[nodiscard]] std::string accept_plot_svg(const std::vector<EvaluationResult>& results,
                                          cv::Size size);

}  // namespace tarsier::face::recognition
