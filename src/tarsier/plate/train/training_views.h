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

// Generates small training images of plates with known corners, endlessly and from a seed. The
// three networks learn from them. They combine real images that have boxes with synthetic plates
// drawn into them, seen through a simulated camera.
namespace tarsier::plate {

// An image and the boxes of its plates, if any.
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
    int position;    // in the plate's text, so that gaps of hidden characters show
  };
  std::vector<Symbol> symbols;  // in reading order, the visible ones
  int length = 0;               // of the text, with hidden characters
};

// Reads the images of a folder with truth.csv (image,x,y,w,h,text), or of a folder of plain images
// (backgrounds without plates). Images larger than `max_pixels` are reduced. Throws InputError.
[[nodiscard]] std::vector<Scene> read_scenes(const std::string& folder, double max_pixels);

// Reads crops NUMBER_KIND-TEXT.jpg, each with a .txt of the same name (class cx cy w h, relative;
// class in the order of kAlphabet). TEXT has '-' for each hidden character. Throws InputError.
[[nodiscard]] std::vector<LabelledCrop> read_labelled_crops(const std::string& folder);

// Splits the crops into training and test sets. No plate is in both sets: crops count as one plate
// if their visible characters agree wherever both show them. A crop that agrees with a test crop is
// not used for training.
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
  // For synthetic plates: the characters' quads in the view.
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
  double drawn = 0.6;   // probability of a synthetic plate instead of a real one
  double none = 0.1;    // probability of a view without a plate
  double yaw_deg = 60;  // maximum, for synthetic plates
  double roll_deg = 20;
  bool centred = false;     // places the plate near the view's centre
  bool valid_text = false;  // the synthetic plate's text always fits a layout of its kind
  bool wild = false;        // uses the worst plausible plate and camera

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

// A false positive of a detector.
struct HardNegative {
  std::size_t scene = 0;
  Quad quad{};
};

struct ViewGenerator {
  std::vector<Scene> scenes;
  std::shared_ptr<const synth::GlyphSet> glyphs;
  std::vector<HardNegative> hard_negatives;  // see find_hard_negatives()
  bool wild = false;                         // trains with ViewOptions::wild

  [[nodiscard]] View make(const ViewOptions& options, Rng& rng) const;
  // A hard negative in the centre of a view; `quad` receives its corners. There must be at least
  // one hard negative.
  [[nodiscard]] View make_hard_negative(const ViewOptions& options, Rng& rng, Quad& quad) const;
};

// Simulates a camera on a grey image: blur, motion, shadow, tone, noise, JPEG.
void simulate_camera(cv::Mat& gray, double strength, Rng& rng);
// Adds the effects of cheap cameras and recorders: sharpening, downscaling and upscaling, strong
// compression, very low contrast.
void simulate_cheap_camera(cv::Mat& gray, Rng& rng);

}  // namespace tarsier::plate
