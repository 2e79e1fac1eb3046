// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/reading_json.h"

#include "tarsier/core/rounding.h"

#include <nlohmann/json.hpp>

namespace tarsier::plate {
namespace {

using Json = nlohmann::ordered_json;

Json corners_json(const Quad& quad) {
  Json corners = Json::array();
  for (const cv::Point2f& p : quad)
    corners.push_back({rounded_to_steps(static_cast<double>(p.x), 10),
                       rounded_to_steps(static_cast<double>(p.y), 10)});
  return corners;
}

}  // namespace

nlohmann::ordered_json reading_json(const Reading& reading) {
  Json characters = Json::array();
  for (const Character& character : reading.characters) {
    characters.push_back({{"text", std::string(1, character.symbol)},
                          {"confidence", rounded_to_steps(character.confidence, 1e4)},
                          {"corners", corners_json(character.corners)}});
  }
  Json candidates = Json::array();
  for (const Candidate& candidate : reading.candidates) {
    candidates.push_back({{"text", candidate.text},
                          {"confidence", rounded_to_steps(candidate.confidence, 1e4)},
                          {"country", candidate.country}});
  }
  nlohmann::ordered_json line{
      {"text", reading.text},
      {"confidence", rounded_to_steps(reading.confidence, 1e4)},
      {"plate", rounded_to_steps(reading.plate, 1e4)},
      {"country", reading.country},
      {"rows", reading.rows},
      {"box", {reading.box.x, reading.box.y, reading.box.width, reading.box.height}},
      {"corners", corners_json(reading.corners)},
      {"characters", std::move(characters)},
      {"candidates", std::move(candidates)}};
  if (!reading.unfit.empty()) line["unfit"] = reading.unfit;
  return line;
}

}  // namespace tarsier::plate
