// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

// What a score is worth: the chance that it is the right person, and how often a stranger gets as
// much.
namespace tarsier::face::recognition {

// Scores from which a calibration is fitted. All are the best score of a probe over a gallery.
struct ScoreSample {
  // Of people who are in the gallery, by other images: the score of the right person.
  std::vector<double> genuine;
  // Of strangers: the best score of anybody; and who the stranger is, as images of one person are
  // alike: each person counts the same however many images there are.
  std::vector<double> stranger;
  std::vector<int> stranger_person;
  double gallery = 1;  // people in the gallery that strangers were compared to, on average
};

// A stranger's score against one person is taken for normal, and those against N people for
// independent: P(best < s) = Phi((s - location) / scale)^N, with location and scale such that mean
// and variance of the best are those seen (over the people of the gallery then). Extrapolates to
// rates below 1 / number of scores, and to galleries of other sizes. The chance to be genuine is
// logistic in the score, fitted with as much weight on genuine as on strangers' scores (even odds
// beforehand).
struct Calibration {
  double location = 0;  // of a stranger's score against one person
  double scale = 1;     // > 0
  double gallery = 1;   // people that the strangers' scores are the best over, >= 1
  double slope = 1;     // of the logistic, >= 0
  double offset = 0;
  // The evidence: how many scores and people it was fitted to. 0 strangers: a prior alone.
  int genuine_scores = 0;
  int stranger_scores = 0;
  int stranger_people = 0;
  double genuine_mean = 0;  // score

  void check() const;

  // The chance that a stranger's best score against `people` people reaches `score`, and the score
  // that he reaches with the chance `rate` in (0, 1).
  [[nodiscard]] double false_accept_rate(double score, int people) const;
  [[nodiscard]] double threshold(double rate, int people) const;
  // 0..1, of the right person against a stranger, where both are as likely beforehand.
  [[nodiscard]] double probability(double score) const;
};

// What is believed before any score is seen, as if `weight` people had been seen.
struct CalibrationPrior {
  double location = 0;
  double scale = 0.1;
  double genuine = 0.5;  // mean score
  double weight = 2;
};

// Throws std::invalid_argument for scores that are not finite or lists of unequal lengths. Few
// strangers leave the prior its weight.
[[nodiscard]] Calibration fit_calibration(const ScoreSample& sample, const CalibrationPrior& prior);

[[nodiscard]] nlohmann::json to_json(const Calibration& calibration);
// Throws ModelError(path).
[[nodiscard]] Calibration calibration_from_json(const nlohmann::json& value,
                                                const std::string& path);

}  // namespace tarsier::face::recognition
