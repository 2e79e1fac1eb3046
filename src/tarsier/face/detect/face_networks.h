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

// Face detection at any size by a cascade of three small networks. The first one evaluates every
// position of an image pyramid; each later one evaluates the candidates of the one before at higher
// resolution (Li, Lin, Shen, Brandt and Hua, "A convolutional neural network cascade for face
// detection", CVPR 2015; Zhang and others, "Joint face detection and alignment using multitask
// cascaded convolutional networks", SPL 2016). Boxes are squares like those of OpenCV's frontal
// cascade: from the eyebrows to the lower lip.
namespace tarsier::face {

// --- the first network ---

// Fully convolutional, on local contrast. For each cell of kScanCell px, the output is a logit
// (whether the centre of a face of about kScanFace px is near) and the box: (dx, dy) of its centre
// from the cell's centre, in kScanFace px, and the logarithm of its width / kScanFace.
inline constexpr int kScanCell = 4;
inline constexpr int kScanFace = 16;
// A pyramid level detects faces of 1 to 1.35 times kScanFace.
inline constexpr double kScanStep = 1.35;
[[nodiscard]] linalg::Network scan_network();

// --- the second and the third ---

// The input is `side` px wide; the box in its middle is `box` px wide. The output says whether it
// is a face, and how to correct the box: (dx, dy) in box widths and the logarithm of the scale.
struct FaceWindow {
  int side = 0;
  int box = 0;
};
inline constexpr FaceWindow kRefineWindow{40, 24};
inline constexpr FaceWindow kVerifyWindow{56, 34};
[[nodiscard]] linalg::Network refine_network();
[[nodiscard]] linalg::Network verify_network();

struct FaceNetworks {
  linalg::Network scan = scan_network();
  linalg::Network refine = refine_network();
  linalg::Network verify = verify_network();
  // Minimum scores of a confident face and of a likely face (a candidate for a closer look), 0..1.
  double confident_score = 0.9;
  double likely_score = 0.5;
  // Throws std::invalid_argument if the networks have other inputs or outputs than these.
  void require() const;
};

struct ScoredFace {
  cv::Rect2d box;    // px
  double score = 0;  // 0..1
};

struct FaceSearchOptions {
  double min_face = 40;           // px, width of the smallest box
  double max_face = 0;            // px, of the largest; 0: as large as the image
  double threshold = 0;           // min score of a face; 0: the networks' `likely_score`
  int max_candidates = 200;       // max candidates of the first network that the second evaluates
  bool with_verification = true;  // false: without the third network

  [[nodiscard]] OptionFields fields() {
    return {{"min_face", min_face, at_least(kScanFace)},
            {"threshold", threshold, range_below(0, 1)},
            {"max_places", max_candidates, range(1, 10000)}};
  }
  void check() const;
};

// Buffers that are reused between images. One per thread.
struct FaceSearchWorkspace {
  linalg::StackWorkspace stack;
  std::vector<cv::Mat> halves;
  cv::Mat level, sums, squares;
  std::vector<std::int32_t> columns;
  std::vector<float> local, input, windows;
  // Cost of the searches so far: pixels of the levels that the first network evaluated, and
  // candidates that the second and the third evaluated.
  std::int64_t pixels = 0;
  std::int64_t candidates = 0;
  std::int64_t verified = 0;
};

// Faces in `gray` (CV_8UC1), best first, after non-maximum suppression. The result does not depend
// on the number of threads.
[[nodiscard]] std::vector<ScoredFace> search_faces(const cv::Mat& gray,
                                                   const FaceNetworks& networks,
                                                   const FaceSearchOptions& options,
                                                   FaceSearchWorkspace& workspace);

// Non-maximum suppression: of boxes that overlap (intersection over union above `overlap`, or one
// mostly inside another), keeps the one with the best score. Best first.
[[nodiscard]] std::vector<ScoredFace> suppress_overlaps(std::vector<ScoredFace> faces,
                                                        double overlap = 0.35);

// Files of this type. read throws ModelError that names path and reason.
inline constexpr std::string_view kFaceNetworksType = "face-networks";
void write_face_networks(const std::string& path, const FaceNetworks& networks,
                         const nlohmann::json& provenance);
[[nodiscard]] FaceNetworks read_face_networks(const std::string& path);

// --- internals used by training ---

// The input of the first network: (value - local mean) / (local deviation + floor). The four pixels
// of each 2 x 2 block become four planes of half the size. Mean and deviation are those of the 17 x
// 17 blocks around the pixel's block. CV_8UC1 with even sides.
void scan_input(const cv::Mat& gray, FaceSearchWorkspace& workspace, std::vector<float>& input);
// The input of the other networks: a square with mean 0 and deviation 1, also in four planes.
void window_input(const cv::Mat& window, std::vector<float>& input);
// Candidates of the first network alone, with its score.
[[nodiscard]] std::vector<ScoredFace> scan_faces(const cv::Mat& gray, const FaceNetworks& networks,
                                                 const FaceSearchOptions& options,
                                                 FaceSearchWorkspace& workspace);
// The image halved repeatedly; [0] is `gray`. A level at `scale` is best computed from
// half_for(scale).
void make_halves(const cv::Mat& gray, double smallest_scale, std::vector<cv::Mat>& halves);
[[nodiscard]] int half_for(double scale, std::size_t count);

}  // namespace tarsier::face
