// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/competing_readings.h"

#include "tarsier/core/statistics.h"
#include "tarsier/plate/networks/evidence.h"
#include "tarsier/plate/networks/quad.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace tarsier::plate {
namespace {

constexpr float kMinCompetingOverlap =
    0.6F;  // share of the smaller box from which only one of two is reported

// The quad around the characters of a plate of one row.
Quad text_quad(const Reading& reading) {
  const Quad& first = reading.characters.front().corners;
  const Quad& last = reading.characters.back().corners;
  return {first[0], last[1], last[2], first[3]};
}

// A town, a state, a dealer: small lettering on a plate, above or below its text.
bool is_slogan_of(const Reading& small, const Reading& plate) {
  constexpr std::size_t kMinCharacters = 4;
  constexpr double kMinPlateProbability = 0.9;
  if (&small == &plate || plate.plate < kMinPlateProbability || plate.rows != 1 ||
      small.rows != 1 || plate.characters.size() < kMinCharacters || small.characters.empty() ||
      box_overlap_of_smaller(plate.corners, small.corners) < 0.9F) {
    return false;
  }
  const Quad text = text_quad(plate);
  if (!is_convex(text, 10) || mean_height(text_quad(small)) > 0.6F * mean_height(text))
    return false;
  const Quad& s = small.corners;
  const cv::Point2f centre = (s[0] + s[1] + s[2] + s[3]) * 0.25F;
  const cv::Point2f at = transformed(map_between(text, quad_of({-0.5F, -0.5F, 1, 1})), centre);
  return std::abs(at.x) < 0.6F && std::abs(at.y) > 0.45F;
}

}  // namespace

std::vector<bool> are_slogans(const std::vector<Reading>& readings) {
  std::vector<bool> slogans;
  slogans.reserve(readings.size());
  for (const Reading& reading : readings) {
    slogans.push_back(std::any_of(readings.begin(), readings.end(), [&](const Reading& plate) {
      return is_slogan_of(reading, plate);
    }));
  }
  return slogans;
}

// Keeps one of the readings that compete for one plate: the one that is most certainly a whole
// plate and reads well. Half a plate may read as well as the whole one, but the aligner's score is
// lower.
std::vector<Reading> suppress_competing(std::vector<Reading> readings) {
  const auto key = [&](std::size_t i) {
    return log_confidence(readings[i]) + 0.5 * log_odds(std::min(readings[i].plate, 0.998));
  };
  std::vector<std::size_t> order(readings.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return key(a) > key(b); });
  std::vector<std::size_t> chosen;
  for (const std::size_t i : order) {
    const auto competing = std::find_if(chosen.begin(), chosen.end(), [&](std::size_t other) {
      return box_overlap_of_smaller(readings[other].corners, readings[i].corners) >
             kMinCompetingOverlap;
    });
    if (competing == chosen.end()) {
      chosen.push_back(i);
    } else if (readings[i].text == readings[*competing].text &&
               readings[i].box.area() < readings[*competing].box.area()) {
      *competing = i;  // for the same text, the tighter box is the plate itself
    }
  }
  std::vector<Reading> results;
  results.reserve(chosen.size());
  for (const std::size_t i : chosen) results.push_back(std::move(readings[i]));
  std::stable_sort(results.begin(), results.end(),
                   [](const Reading& a, const Reading& b) { return a.confidence > b.confidence; });
  return results;
}

}  // namespace tarsier::plate
