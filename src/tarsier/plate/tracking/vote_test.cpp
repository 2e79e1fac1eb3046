// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/vote.h"

#include "tarsier/plate/tracking/testing_readings.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

namespace tarsier::plate {
namespace {

Reading reading_of(const std::string& text, double confidence, int height = 20) {
  Reading reading;
  reading.text = text;
  reading.confidence = confidence;
  reading.box = {0, 0, 5 * height, height};
  return reading;
}

std::string winner(const std::vector<Reading>& readings, const VoteOptions& options = {}) {
  std::vector<Ballot> ballots;
  for (const Reading& reading : readings) ballots.push_back(ballot_of(reading));
  const std::vector<Candidate> candidates = vote(ballots, options);
  return candidates.empty() ? "" : candidates.front().text;
}

TEST(VoteTest, SingleReadingIsUnchanged) {
  const std::vector<Candidate> voted = vote({ballot_of(reading_of("1234BCD", 0.8))}, {});
  ASSERT_FALSE(voted.empty());
  EXPECT_EQ(voted[0].text, "1234BCD");
  EXPECT_NEAR(voted[0].confidence, 0.8, 0.1);
  EXPECT_TRUE(vote({}, {}).empty());
}

TEST(VoteTest, MajorityWinsAmongEqualReadings) {
  EXPECT_EQ(
      winner({reading_of("1234BCD", 0.6), reading_of("1284BCD", 0.6), reading_of("1234BCD", 0.6)}),
      "1234BCD");
}

TEST(VoteTest, ConfidentReadingOutvotesManyUncertainOnes) {
  std::vector<Reading> readings(20, reading_of("1Z34BCD", 0.25, 9));
  readings.push_back(reading_of("1234BCD", 0.97, 30));
  EXPECT_EQ(winner(readings), "1234BCD");
}

TEST(VoteTest, CombinesCharactersOfSeveralReadings) {
  // Each frame has another wrong character, with a low confidence.
  std::vector<Reading> readings;
  for (const auto& [text, wrong] : std::vector<std::pair<std::string, std::size_t>>{
           {"X234BCD", 0}, {"12Y4BCD", 2}, {"1234BZD", 5}}) {
    Reading reading = reading_of(text, 0.4);
    for (std::size_t k = 0; k < text.size(); ++k) {
      reading.characters.push_back({text[k], k == wrong ? 0.45 : 0.97, {}});
    }
    readings.push_back(reading);
  }
  EXPECT_EQ(winner(readings), "1234BCD");
}

TEST(VoteTest, PrefersTextsOfALayout) {
  Reading reading = reading_of("12O4BCD", 0.4);
  reading.candidates = {{"12O4BCD", 0.4, ""}, {"1204BCD", 0.35, "es"}};
  VoteOptions options;
  EXPECT_EQ(winner({reading}, options), "1204BCD");
  options.layout_bonus = 0;
  EXPECT_EQ(winner({reading}, options), "12O4BCD");
}

TEST(VoteTest, AgreementRaisesTheConfidenceUpToALimit) {
  const auto confidence = [](int count) {
    const std::vector<Ballot> ballots(static_cast<std::size_t>(count),
                                      ballot_of(reading_of("1234BCD", 0.6)));
    return vote(ballots, {}).front().confidence;
  };
  EXPECT_GT(confidence(4), confidence(1) + 0.05);
  EXPECT_LT(confidence(500), 0.99);  // all frames may make the same error
  double sum = 0;
  for (const Candidate& candidate :
       vote({ballot_of(reading_of("A1", 0.5)), ballot_of(reading_of("B2", 0.5))}, {})) {
    sum += candidate.confidence;
  }
  EXPECT_LE(sum, 1 + 1e-9);
}

// Typical tracks: growing plates, most frames poor. The vote is right more often than the most
// confident frame, and rarely wrong where that frame is right.
TEST(VoteTest, IsMoreAccurateThanTheBestReading) {
  Rng rng(11);
  int best_correct = 0;
  int voted_correct = 0;
  int lost = 0;
  constexpr int kTracks = 400;
  for (int n = 0; n < kTracks; ++n) {
    std::string text;
    for (int k = 0; k < 7; ++k) text += kAlphabet[static_cast<std::size_t>(rng.integer(0, 35))];
    std::vector<Reading> readings;
    const int count = rng.integer(1, 25);
    const double error = rng.uniform(0.02, 0.45);
    for (int k = 0; k < count; ++k) {
      const int height = 10 + 15 * k / count;
      readings.push_back(noisy_reading(text, {0, 0, 5 * height, height}, error * 15 / height, rng));
    }
    const auto best = std::max_element(
        readings.begin(), readings.end(),
        [](const Reading& a, const Reading& b) { return a.confidence < b.confidence; });
    const bool voted = winner(readings) == text;
    best_correct += best->text == text ? 1 : 0;
    voted_correct += voted ? 1 : 0;
    lost += best->text == text && !voted ? 1 : 0;
  }
  EXPECT_GT(voted_correct, best_correct + kTracks / 20);
  EXPECT_LE(lost, kTracks / 100);
  RecordProperty("best", best_correct);
  RecordProperty("voted", voted_correct);
}

TEST(VoteTest, RejectsInvalidOptions) {
  VoteOptions options;
  options.candidates = 0;
  EXPECT_THROW((void)vote({}, options), std::invalid_argument);
  options = {};
  options.independent = 0.5;
  EXPECT_THROW((void)vote({}, options), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::plate
