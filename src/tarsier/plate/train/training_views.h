// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/rng.h"
#include "tarsier/plate/networks/quad.h"
#include "tarsier/synth/plates.h"

#include <opencv2/core.hpp>

#include <memory>
#include <string>
#include <vector>

// Small images of plates with known corners, endless and seeded: what the three networks learn
// from. Real images with boxes and drawn plates set into them, seen through a made-up camera.
namespace tarsier::plate {

// An image and the boxes of its plates, if it has any.
struct Scene {
  cv::Mat image;  // CV_8UC3
  std::vector<cv::Rect2f> plates;
};

// The plate of an image with boxes around its characters.
struct LabelledCrop {
  cv::Mat image;  // CV_8UC3
  struct Symbol {
    char symbol;
    cv::Rect2f box;  // px of `image`
    int place;       // in the plate's text, so that hidden neighbours show
  };
  std::vector<Symbol> symbols;  // in reading order, the visible ones
  int length = 0;               // of the text, hidden ones included
};

// Images of a folder with truth.csv (image,x,y,w,h,text), or of a folder of plain images
// (backgrounds without plates). Larger ones than `max_pixels` are reduced. Throws InputError.
[[nodiscard]] std::vector<Scene> read_scenes(const std::string& folder, double max_pixels);

// Crops NUMBER_KIND-TEXT.jpg with a .txt of the same name (class cx cy w h, relative; class in the
// order of kAlphabet); TEXT has '-' for each character that is hidden. Throws InputError.
[[nodiscard]] std::vector<LabelledCrop> read_labelled_crops(const std::string& folder);

// A share of the crops to judge by. No plate is on both sides: crops whose visible characters agree
// wherever both show them count as one plate, and what agrees with a crop judged by is not learnt.
struct CropSplit {
  std::vector<LabelledCrop> train;
  std::vector<LabelledCrop> test;
};
[[nodiscard]] CropSplit split_crops(std::vector<LabelledCrop> crops, double test_share, Rng rng);

struct ViewPlate {
  Quad plate{};
  Quad text{};
  bool has_text_quad = false;
  int rows = 1;
  // Of drawn plates: the characters' quads in the view.
  struct Symbol {
    char symbol;
    Quad quad;
    int row;
  };
  std::vector<Symbol> symbols;
};

struct View {
  cv::Mat gray;  // CV_8UC1
  std::vector<ViewPlate> plates;
};

struct ViewOptions {
  cv::Size size{160, 112};
  double min_width = 26;  // of plates, px of the view
  double max_width = 90;
  double drawn = 0.6;   // chance of a drawn plate rather than a real one
  double none = 0.1;    // chance of no plate at all
  double yaw_deg = 60;  // of drawn plates at most
  double roll_deg = 20;
  bool centred = false;  // the plate near the view's middle
  bool lawful = false;  // the drawn plate's text is of its kind's layouts, never groups of anything
  bool wild = false;    // the drawn plate and the camera as bad as they are met

  [[nodiscard]] OptionFields fields() {
    return {{"size.width", size.width, range(16, 4096)},
            {"size.height", size.height, range(16, 4096)},
            {"min_width", min_width, above(0, 4096)},
            {"max_width", max_width, above(0, 4096)},
            {"drawn", drawn, range(0, 1)},
            {"none", none, range(0, 1)},
            {"yaw_deg", yaw_deg, range_below(0, 90)},
            {"roll_deg", roll_deg, range(0, 180)}};
  }
  void check() const;  // throws std::invalid_argument
};

// Something in an image that a detector took for a plate.
struct Distractor {
  std::size_t scene = 0;
  Quad quad{};
};

struct ViewMaker {
  std::vector<Scene> scenes;
  std::shared_ptr<const synth::GlyphSet> glyphs;
  std::vector<Distractor> distractors;  // see find_distractors()
  bool wild = false;                    // what is learnt from is ViewOptions::wild

  [[nodiscard]] View make(const ViewOptions& options, Rng& rng) const;
  // A distractor in the middle of a view; `quad` becomes where. There must be one.
  [[nodiscard]] View make_distractor(const ViewOptions& options, Rng& rng, Quad& quad) const;
};

// What a camera does to a grey image: blur, motion, shadow, tone, noise, JPEG.
void weather(cv::Mat& gray, double strength, Rng& rng);
// What cheap cameras and recorders do then: sharpening, another size and back, strong compression,
// hardly any contrast.
void wild_weather(cv::Mat& gray, Rng& rng);

}  // namespace tarsier::plate
