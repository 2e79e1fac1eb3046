// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/linalg/network_stack.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

// Faces of any size, by three small networks: one looks at every place of a pyramid, the others
// judge what the one before took for a face, at more and more detail (a cascade of networks: Li,
// Lin, Shen, Brandt and Hua, "A convolutional neural network cascade for face detection", CVPR
// 2015; Zhang and others, "Joint face detection and alignment using multitask cascaded
// convolutional networks", SPL 2016). Boxes are squares as the frontal cascade of OpenCV draws
// them: from the brows to the lower lip.
namespace tarsier::face {

// --- the first network ---

// Fully convolutional, on local contrast. Each cell of kScanCell px says whether the middle of a
// face of about kScanFace px is near (a logit), and where its box lies: (dx, dy) of its middle from
// the cell's, in kScanFace px, and the logarithm of its width over kScanFace.
inline constexpr int kScanCell = 4;
inline constexpr int kScanFace = 16;
inline constexpr double kScanStep = 1.35;  // a level sees faces of 1 to 1.35 times kScanFace
[[nodiscard]] linalg::Network scan_network();

// --- the second and the third ---

// See `side` px around a box that is `box` px wide there; say whether it is a face, and how the box
// should move: (dx, dy) in its widths and the logarithm of its growth.
struct FaceWindow {
  int side = 0;
  int box = 0;
};
inline constexpr FaceWindow kJudgeWindow{40, 24};
inline constexpr FaceWindow kCheckWindow{56, 34};
[[nodiscard]] linalg::Network judge_network();
[[nodiscard]] linalg::Network check_network();

struct FaceNetworks {
  linalg::Network scan = scan_network();
  linalg::Network judge = judge_network();
  linalg::Network check = check_network();
  // Scores from which a find is taken for a face, and from which it is worth a closer look, 0..1.
  double sure = 0.9;
  double likely = 0.5;
  // Throws std::invalid_argument where the networks have other inputs or outputs than these.
  void require() const;
};

struct ScoredFace {
  cv::Rect2d box;    // px
  double score = 0;  // 0..1
};

struct FaceSearchOptions {
  double min_face = 40;  // px, width of the smallest box
  double max_face = 0;   // px, of the largest; 0: as large as the image
  double threshold = 0;  // score of a face; 0: the networks' `likely`
  int max_places = 200;  // that the second network looks at, the best of the first
  bool checked = true;   // false: without the third network

  [[nodiscard]] OptionFields fields() {
    return {{"min_face", min_face, at_least(kScanFace)},
            {"threshold", threshold, range_below(0, 1)},
            {"max_places", max_places, range(1, 10000)}};
  }
  void check() const;
};

// Buffers, reused from image to image. One for each thread.
struct FaceSearchWorkspace {
  linalg::StackWorkspace stack;
  std::vector<cv::Mat> halves;
  cv::Mat level, sums, squares;
  std::vector<std::int32_t> columns;
  std::vector<float> local, input, windows;
  // What the searches cost so far: pixels of levels that the first network saw, and places that the
  // second and the third looked at.
  std::int64_t pixels = 0;
  std::int64_t places = 0;
  std::int64_t checked = 0;
};

// Faces in `gray` (CV_8UC1), best first; of those that overlap the best stays. The same for any
// number of threads.
[[nodiscard]] std::vector<ScoredFace> search_faces(const cv::Mat& gray,
                                                   const FaceNetworks& networks,
                                                   const FaceSearchOptions& options,
                                                   FaceSearchWorkspace& workspace);

// Of boxes that overlap (intersection over union above `overlap`, or one mostly inside another) the
// one of the best score. Returned best first.
[[nodiscard]] std::vector<ScoredFace> suppress_overlaps(std::vector<ScoredFace> faces,
                                                        double overlap = 0.35);

// Files of this type. read throws ModelError naming path and reason.
inline constexpr std::string_view kFaceNetworksType = "face-networks";
void write_face_networks(const std::string& path, const FaceNetworks& networks,
                         const nlohmann::json& provenance);
[[nodiscard]] FaceNetworks read_face_networks(const std::string& path);

// --- what training needs of the inside ---

// The input of the first network: (value - local mean) / (local deviation + floor), the four pixels
// of each 2 x 2 block as four planes of half the size; mean and deviation are those of the 17 x 17
// blocks around the pixel's. CV_8UC1 of even sides.
void scan_input(const cv::Mat& gray, FaceSearchWorkspace& workspace, std::vector<float>& input);
// The input of the others: a square, mean 0 and deviation 1, in four planes as well.
void window_input(const cv::Mat& window, std::vector<float>& input);
// Only what the first network finds, with its own score.
[[nodiscard]] std::vector<ScoredFace> scan_faces(const cv::Mat& gray, const FaceNetworks& networks,
                                                 const FaceSearchOptions& options,
                                                 FaceSearchWorkspace& workspace);
// The image halved again and again; [0] is `gray`. A level at `scale` is best made from
// half_for(scale).
void make_halves(const cv::Mat& gray, double smallest_scale, std::vector<cv::Mat>& halves);
[[nodiscard]] int half_for(double scale, std::size_t count);

}  // namespace tarsier::face
