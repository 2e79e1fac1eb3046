// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/vote.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <utility>

namespace tarsier::plate {
namespace {

constexpr std::size_t kMaxCandidates = 5;  // of a ballot
constexpr std::size_t kMaxVoters = 40;
constexpr std::size_t kMaxTexts = 24;
constexpr double kMinLogProbability = -7;  // nats
// Costs of edits between a candidate and a text, nats: an insertion or deletion, and a substitution
// about which nothing is known.
constexpr double kIndelCost = 4;
constexpr double kSubstitutionCost = 3.5;
constexpr double kMinSubstitutionCost = 1.5;
constexpr double kMaxSubstitutionCost = 7;

struct Voter {
  const Ballot* ballot = nullptr;
  double weight = 0;
};

double log_of(double p) { return std::log(std::clamp(p, 1e-6, 1.0)); }

// Cost of substituting the k-th character of a ballot's first candidate.
double substitution_cost(const Ballot& ballot, std::size_t k) {
  if (k >= ballot.characters.size()) return kSubstitutionCost;
  // The uncertainty is divided among a few likely other symbols.
  const double alternative = (1 - ballot.characters[k]) / 3;
  return std::clamp(-log_of(alternative), kMinSubstitutionCost, kMaxSubstitutionCost);
}

// Minimum cost of editing the n-th candidate into `text`; `most` if it is not lower.
double edit_cost(const Ballot& ballot, std::size_t n, const std::string& text, double max_cost) {
  const std::string& candidate_text = ballot.candidates[n].text;
  if (candidate_text == text) return 0;
  const double difference =
      std::abs(static_cast<double>(candidate_text.size()) - static_cast<double>(text.size()));
  if (difference * kIndelCost >= max_cost) return max_cost;
  std::vector<double> row(text.size() + 1);
  for (std::size_t j = 0; j < row.size(); ++j) row[j] = kIndelCost * static_cast<double>(j);
  for (std::size_t i = 0; i < candidate_text.size(); ++i) {
    double diagonal = row[0];
    row[0] += kIndelCost;
    const double other = n == 0 ? substitution_cost(ballot, i) : kSubstitutionCost;
    for (std::size_t j = 1; j < row.size(); ++j) {
      const double replaced = diagonal + (candidate_text[i] == text[j - 1] ? 0 : other);
      diagonal = row[j];
      row[j] = std::min({row[j] + kIndelCost, row[j - 1] + kIndelCost, replaced});
    }
  }
  return std::min(row.back(), max_cost);
}

// Score that one ballot gives to a text, nats.
double ballot_score(const Ballot& ballot, const std::string& text) {
  double best = kMinLogProbability;
  for (std::size_t n = 0; n < std::min(kMaxCandidates, ballot.candidates.size()); ++n) {
    const double own = log_of(ballot.candidates[n].confidence);
    if (own <= best) continue;
    best = std::max(best, own - edit_cost(ballot, n, text, own - best));
  }
  return best;
}

double unassigned_probability(const Ballot& ballot) {
  double sum = 0;
  for (std::size_t n = 0; n < std::min(kMaxCandidates, ballot.candidates.size()); ++n) {
    sum += ballot.candidates[n].confidence;
  }
  return std::max(1 - sum, 0.01);
}

std::vector<Voter> voters_of(const std::vector<Ballot>& ballots) {
  double highest = 0;
  for (const Ballot& ballot : ballots) highest = std::max(highest, ballot.height_px);
  std::vector<Voter> voters;
  for (const Ballot& ballot : ballots) {
    if (!ballot.candidates.empty()) voters.push_back({&ballot, weight_of(ballot, highest)});
  }
  std::stable_sort(voters.begin(), voters.end(),
                   [](const Voter& a, const Voter& b) { return a.weight > b.weight; });
  if (voters.size() > kMaxVoters) voters.resize(kMaxVoters);
  for (std::size_t k = 0; k < voters.size(); ++k) {
    voters[k].weight /= 1 + static_cast<double>(k) / 5;
  }
  return voters;
}

// A candidate of the vote, and the country of its layout.
struct Nominee {
  std::string text;
  std::string country;
  double support = 0;
};

// For each length, the text of the characters with the most votes at each place.
void add_voted_by_character(const std::vector<Voter>& voters,
                            std::map<std::string, Nominee>& nominees_by_text) {
  std::map<std::size_t, double> lengths;
  std::map<std::pair<std::size_t, std::size_t>, std::map<char, double>> positions;
  for (const Voter& voter : voters) {
    const Ballot& ballot = *voter.ballot;
    for (std::size_t n = 0; n < std::min(kMaxCandidates, ballot.candidates.size()); ++n) {
      const std::string& text = ballot.candidates[n].text;
      const double share = voter.weight * ballot.candidates[n].confidence;
      lengths[text.size()] += share;
      for (std::size_t k = 0; k < text.size(); ++k) {
        const bool known = n == 0 && k < ballot.characters.size();
        positions[{text.size(), k}][text[k]] += share * (known ? ballot.characters[k] : 0.5);
      }
    }
  }
  for (const auto& [length, support] : lengths) {
    std::string text;
    for (std::size_t k = 0; k < length; ++k) {
      const auto& votes = positions[{length, k}];
      text += std::max_element(votes.begin(), votes.end(), [](const auto& a, const auto& b) {
                return a.second < b.second;
              })->first;
    }
    Nominee& nominee = nominees_by_text[text];
    nominee.text = text;
    nominee.support = std::max(nominee.support, support);
  }
}

std::vector<Nominee> nominees_of(const std::vector<Voter>& voters) {
  std::map<std::string, Nominee> nominees_by_text;
  for (const Voter& voter : voters) {
    const Ballot& ballot = *voter.ballot;
    for (std::size_t n = 0; n < std::min(kMaxCandidates, ballot.candidates.size()); ++n) {
      const Candidate& candidate = ballot.candidates[n];
      if (candidate.text.empty()) continue;
      Nominee& nominee = nominees_by_text[candidate.text];
      nominee.text = candidate.text;
      if (nominee.country.empty()) nominee.country = candidate.country;
      nominee.support += voter.weight * candidate.confidence;
    }
  }
  add_voted_by_character(voters, nominees_by_text);
  std::vector<Nominee> nominees;
  for (auto& [text, nominee] : nominees_by_text) {
    if (!text.empty()) nominees.push_back(std::move(nominee));
  }
  std::stable_sort(nominees.begin(), nominees.end(),
                   [](const Nominee& a, const Nominee& b) { return a.support > b.support; });
  if (nominees.size() > kMaxTexts) nominees.resize(kMaxTexts);
  return nominees;
}

}  // namespace

Ballot ballot_of(const Reading& reading) {
  Ballot ballot;
  ballot.candidates = reading.candidates;
  if (ballot.candidates.empty() || ballot.candidates.front().text != reading.text) {
    ballot.candidates = {{reading.text, reading.confidence, reading.country}};
  }
  if (ballot.candidates.size() > kMaxCandidates) ballot.candidates.resize(kMaxCandidates);
  // The confidence of the reading is the calibrated one; the other candidates share the rest.
  const double confidence = std::clamp(reading.confidence, 0.0, 1.0);
  const double others = 1 - ballot.candidates.front().confidence;
  const double scale = others > 1e-6 ? std::min(1.0, (1 - confidence) / others) : 0;
  for (Candidate& candidate : ballot.candidates) candidate.confidence *= scale;
  ballot.candidates.front().confidence = confidence;
  if (ballot.candidates.front().country.empty())
    ballot.candidates.front().country = reading.country;
  if (reading.characters.size() == reading.text.size()) {
    for (const Character& character : reading.characters) {
      ballot.characters.push_back(std::clamp(character.confidence, 0.0, 1.0));
    }
  }
  ballot.height_px = static_cast<double>(reading.box.height) / std::max(reading.rows, 1);
  return ballot;
}

double weight_of(const Ballot& ballot, double highest_px) {
  if (ballot.candidates.empty()) return 0;
  const double confidence = std::clamp(ballot.candidates.front().confidence, 0.02, 1.0);
  const double size = highest_px > 0 ? std::clamp(ballot.height_px / highest_px, 0.1, 1.0) : 1;
  return confidence * std::sqrt(confidence) * size;
}

std::vector<Candidate> vote(const std::vector<Ballot>& ballots, const VoteOptions& options) {
  options.check();
  const std::vector<Voter> voters = voters_of(ballots);
  const std::vector<Nominee> nominees = nominees_of(voters);
  if (nominees.empty()) return {};
  const double all = std::accumulate(voters.begin(), voters.end(), 0.0,
                                     [](double sum, const Voter& v) { return sum + v.weight; });
  const double scale = std::min(1.0, options.independent / all);
  std::vector<std::pair<double, const Nominee*>> scores;
  double none_score = 0;  // none of these
  for (const Voter& voter : voters)
    none_score += voter.weight * log_of(unassigned_probability(*voter.ballot));
  for (const Nominee& nominee : nominees) {
    double score = nominee.country.empty() ? 0 : options.layout_bonus;
    for (const Voter& voter : voters)
      score += voter.weight * ballot_score(*voter.ballot, nominee.text);
    scores.emplace_back(score, &nominee);
  }
  std::stable_sort(scores.begin(), scores.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  const double best = std::max(scores.front().first, none_score);
  double total = std::exp(scale * (none_score - best));
  for (const auto& [score, nominee] : scores) total += std::exp(scale * (score - best));
  std::vector<Candidate> result;
  for (const auto& [score, nominee] : scores) {
    if (result.size() == static_cast<std::size_t>(options.candidates)) break;
    result.push_back({nominee->text, std::exp(scale * (score - best)) / total, nominee->country});
  }
  return result;
}

}  // namespace tarsier::plate
