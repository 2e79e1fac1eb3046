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

// Evaluates recognisers on a list of labelled faces.
namespace tarsier::face::recognition {

struct LabelledFace {
  std::string path;
  std::string label;
  std::optional<cv::Point2d> left_eye{};  // px, as seen in the image; both eyes or none
  std::optional<cv::Point2d> right_eye{};
};

// Reads lines `path<TAB>label`. Four more fields may give the true eyes: x y x y of the left and
// the right eye as seen in the image. A relative path that does not exist in the working directory
// is taken from the list's folder. Empty lines and lines that begin with # are ignored. Throws
// InputError with the line number.
[[nodiscard]] std::vector<LabelledFace> read_face_list(const std::string& path);

struct EvaluationOptions {
  int training = 5;  // training images per person
  // If not 0, the first `gallery` faces are the training set and all others are probes. 0:
  // `training` random images of each person.
  int gallery = 0;
  std::vector<std::uint64_t> seeds{0, 1, 2, 3, 4};  // 1..1000 seeds, one random split each
  // For each face, whether it may be in the training set; empty: all may. Probes that may not are
  // counted separately.
  std::vector<bool> may_train;
  bool open_set = true;  // evaluate also with only some of the people enrolled
  int enrolled = 0;      // number of enrolled people for this; 0: half, rounded down
  // False accept rate at which true accepts are counted. The threshold is chosen on the evaluated
  // scores themselves. So it shows how well the scores separate people; no user has that threshold
  // beforehand.
  double false_accepts = 0.01;
  // False accept rate for which each model calibrates its own threshold. This is the rate that a
  // user gets.
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

// A split into training faces and probes. Of each person (labels in sorted order), `training`
// random images train and all others are probes. The split is the same as numpy's:
//   r = RandomState(seed); for each person: r.permutation(images)[:training]
//   RandomState(seed + 1000).permutation(people)[:enrolled] are enrolled (if only some are).
// The upper 32 bits of `seed` are ignored.
struct Split {
  std::vector<int> training;  // indices into the faces, ascending
  std::vector<int> probes;
};
// Only `enrolled` random people train (0: all); all images of the others are probes. `may_train`:
// as in EvaluationOptions; only these images can be chosen for training.
[[nodiscard]] Split split_of(const std::vector<std::string>& labels, int training,
                             std::uint64_t seed, int enrolled = 0,
                             const std::vector<bool>& may_train = {});
// Of the first `gallery` faces, those of `enrolled` random people train (0: of all). The faces
// after them are probes. A gallery of 0 or of all faces leaves one of the two sets empty.
[[nodiscard]] Split split_of_gallery(const std::vector<std::string>& labels, int gallery,
                                     std::uint64_t seed, int enrolled = 0);
[[nodiscard]] int count_people(const std::vector<std::string>& labels);

// The result of one probe.
struct ProbeResult {
  int face = 0;
  bool known = false;    // whether the person is enrolled
  bool correct = false;  // whether the best label is right
  double score = 0;      // of the best label
  int rank = 0;          // of the right person among all, from 1; 0: person not enrolled
};

// Number of hits among a number of trials.
struct Count {
  long hits = 0;
  long trials = 0;
};

// A rate over several random splits of the same images, with its 95 % interval. The splits share
// most of their probes. So the interval is computed from the number of trials of one split
// (wilson_interval_of_rate). It holds for other images of similar people. Other people and other
// cameras differ by more.
struct Rate {
  Count count;  // sum over all splits
  int draws = 0;
  double value = -1;  // count.hits / count.trials; -1: no trials
  Interval interval;
};

struct SeedResult {
  std::uint64_t seed = 0;
  int people = 0;
  int training = 0;  // images
  int probes = 0;
  double accuracy = 0;  // share of probes whose best label is right; all people enrolled
  // With only some of the people enrolled (`open_set`); negative otherwise:
  // Share of known probes above the threshold that at most `false_accepts` of the strangers reach.
  double true_accept_rate = -1;
  double correct_accept_rate = -1;  // the same, and with the right label (DIR)
  double equal_error_rate = -1;     // EER
  double auc = -1;                  // area under the ROC curve
  // Share of known probes above the model's own threshold for `stated_rate`.
  double calibrated_true_accept_rate = -1;
  double calibrated_correct_accept_rate = -1;  // the same, and with the right label
  double calibrated_false_accept_rate =
      -1;  // share of strangers above that threshold; compare with `stated_rate`
  int known_probes = 0;
  int unknown_probes = 0;
  bool calibrated = false;  // whether the model has its own threshold
  // The same rates as counts.
  Count identified;
  Count true_accept_count;
  Count correct_accept_count;
  Count calibrated_true_accept_count;
  Count calibrated_correct_accept_count;
  Count calibrated_false_accept_count;
  // The same for probes that may not train (EvaluationOptions::may_train). These probes are not
  // part of any other figure, nor of `probes`, `closed_set` and `open_set`.
  Count uncertain_identified;
  Count uncertain_true_accept_count;
  Count uncertain_false_accept_count;
  double train_seconds = 0;
  double identify_ms = 0;               // mean time per probe, including its description
  std::vector<ProbeResult> closed_set;  // all people enrolled
  std::vector<ProbeResult> open_set;    // only some of the people enrolled
};

struct EvaluationResult {
  Algorithm algorithm = Algorithm::kDefault;
  EvaluationOptions options;
  std::vector<SeedResult> seeds;

  bool with_background = false;

  // Rates and times: means over the seeds. Counts, also of probes: sums.
  [[nodiscard]] SeedResult mean() const;
  // The rate over all seeds, e.g. rate(&SeedResult::calibrated_false_accept_count).
  [[nodiscard]] Rate rate(Count SeedResult::*count) const;
};

// Faces are CV_8UC1. `background` as in train(). The recogniser of a gallery is trained with the
// installed background, so pass it for figures of the product. Throws std::invalid_argument if
// nobody has more images than `training`; for strangers also if there are fewer than two people or
// no strangers. Throws Interrupted.
[[nodiscard]] EvaluationResult evaluate(const std::vector<cv::Mat>& faces,
                                        const std::vector<std::string>& labels,
                                        const RecognizerOptions& recognizer,
                                        const EvaluationOptions& options, Progress& progress,
                                        const std::stop_token& stop,
                                        const Background* background = nullptr);

// A curve over all seeds.
struct Curve {
  std::vector<double> x;
  std::vector<double> y;
};
// Cumulative match: rank (from 1) -> share of closed probes whose person has this rank or a better
// one.
[[nodiscard]] Curve cmc_curve(const EvaluationResult& result);
// False accept rate -> true accept rate, one point for each distinct score.
[[nodiscard]] Curve roc_curve(const EvaluationResult& result);

// Rates from the scores of known people and of strangers. The threshold is the lowest score that at
// most `rate` of the strangers reach (score >= threshold).
struct AcceptRates {
  double threshold = 0;
  double true_accept_rate = 0;
  double equal_error_rate = 0;
  double auc = 0;
};
[[nodiscard]] AcceptRates accept_rates(std::vector<double> genuine, std::vector<double> impostor,
                                       double rate);

// Columns "algorithm,training,seed,people,probes,identified,accuracy,..": a line for each seed and
// one for all seeds ("all" in the seed's place). The latter has sums of counts and means of rates
// and times. "training" is the option of this name; with a gallery it is the number of the
// gallery's faces.
[[nodiscard]] std::string evaluation_csv(const std::vector<EvaluationResult>& results);
// Plots of all algorithms (CV_8UC3; SVG text).
[[nodiscard]] cv::Mat cmc_plot(const std::vector<EvaluationResult>& results, cv::Size size);
[[nodiscard]] cv::Mat roc_plot(const std::vector<EvaluationResult>& results, cv::Size size);
[[nodiscard]] std::string cmc_plot_svg(const std::vector<EvaluationResult>& results, cv::Size size);
[[nodiscard]] std::string roc_plot_svg(const std::vector<EvaluationResult>& results, cv::Size size);

}  // namespace tarsier::face::recognition
