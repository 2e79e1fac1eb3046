// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <array>
#include <string>
#include <string_view>
#include <vector>

// The result of reading a number plate. Images are CV_8UC3 (BGR) or CV_8UC1. Coordinates are pixels
// of the whole image; (0, 0) is the centre of its first pixel.
namespace tarsier::plate {

// The symbols on plates, in the order of their class numbers. Class kBlank means "no character
// here".
inline constexpr std::string_view kAlphabet = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ";
inline constexpr int kBlank = 36;
inline constexpr int kClasses = 37;

// Class number of a symbol of kAlphabet, -1 for any other.
[[nodiscard]] int class_of(char symbol);

// Corners of a plate in reading orientation: top left, top right, bottom right, bottom left.
using Quad = std::array<cv::Point2f, 4>;

// The smallest upright box around the quad, clipped to `size`.
[[nodiscard]] cv::Rect bounding_box(const Quad& quad, cv::Size size);

struct Character {
  char symbol = '?';
  double confidence = 0;  // 0..1
  Quad corners{};         // in the image
};

struct Candidate {
  std::string text;
  double confidence = 0;  // 0..1; the confidences of one plate's candidates sum to at most 1
  std::string country;    // code of the layout ("es", "sk"..), empty if no layout fits
};

// One plate of one image.
struct Reading {
  std::string text;       // candidates[0].text; symbols of kAlphabet only
  double confidence = 0;  // 0..1: probability that the whole text is correct
  double plate = 0;       // 0..1: probability that this is a plate, whatever its text
  std::string country;    // of the best candidate
  cv::Rect box;           // upright, within the image
  Quad corners{};
  int rows = 1;  // rows of characters
  std::vector<Character> characters;
  std::vector<Candidate> candidates;  // best first; all texts differ
  // The text that the plate shows, if it is far from every text of the requested countries. Empty
  // if a text of these countries is near it, or if all countries are allowed.
  std::string unfit;
};

}  // namespace tarsier::plate
