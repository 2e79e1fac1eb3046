// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

// The meaning of a score: the probability that it is the right person, and how often a stranger
// reaches it.
namespace tarsier::face::recognition {

// Scores from which a calibration is fitted. Each is the best score of a probe against a gallery.
struct ScoreSample {
  // Enrolled people, probed with other images: the score of the right person.
  std::vector<double> genuine;
  // Impostors (strangers): the best score of any enrolled person, and the index of the stranger.
  // Each stranger has the same total weight, because images of one person are similar.
  std::vector<double> impostor;
  std::vector<int> impostor_person;
  double gallery = 1;  // mean number of enrolled people that strangers were compared with
};

// A stranger's scores against single people are modelled as normal, and those against N people as
// independent: P(best < s) = Phi((s - location) / scale)^N. Location and scale reproduce the
// observed mean and variance of the best score, for the gallery size of that time. The model
// extrapolates to rates below 1 / number of scores and to other gallery sizes. The probability of a
// genuine match is logistic in the score. It is fitted with equal total weight of genuine and
// impostor scores (even prior odds).
struct Calibration {
  double location = 0;  // of a stranger's score against one person
  double scale = 1;     // > 0
  double gallery = 1;   // people in the gallery of the strangers' scores, >= 1
  double slope = 1;     // of the logistic, >= 0
  double offset = 0;
  // The data: number of scores and people it was fitted to. 0 strangers: the prior alone.
  int genuine_scores = 0;
  int impostor_scores = 0;
  int impostor_people = 0;
  double genuine_mean = 0;  // score

  void check() const;

  // The probability that a stranger's best score against `people` people reaches `score`, and the
  // score that a stranger reaches with the probability `rate` in (0, 1).
  [[nodiscard]] double false_accept_rate(double score, int people) const;
  [[nodiscard]] double threshold(double rate, int people) const;
  // Probability, 0..1, of the right person against a stranger, with equal prior probabilities.
  [[nodiscard]] double probability(double score) const;
};

// Prior of a calibration, weighted as `weight` observed people.
struct CalibrationPrior {
  double location = 0;
  double scale = 0.1;
  double genuine = 0.5;  // mean score
  double weight = 2;
};

// Throws std::invalid_argument for scores that are not finite or lists of unequal lengths. With few
// strangers, the prior dominates.
[[nodiscard]] Calibration fit_calibration(const ScoreSample& sample, const CalibrationPrior& prior);

[[nodiscard]] nlohmann::json to_json(const Calibration& calibration);
// Throws ModelError(path).
[[nodiscard]] Calibration calibration_from_json(const nlohmann::json& value,
                                                const std::string& path);

}  // namespace tarsier::face::recognition
