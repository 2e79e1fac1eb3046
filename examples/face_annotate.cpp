// SPDX-License-Identifier: MIT
// face_annotate SET IMAGE: proposes the points of an image from other images that were annotated by
// hand.
//   face_annotate my-faces.json next.png
// SET is the file of `tarsier landmarks annotate`. Without one, try it with two equal images:
//   face_annotate face.png face.png   (marks the centre of the first, finds it in the second)
#include "tarsier/core/errors.h"
#include "tarsier/face/pipelines/annotator.h"
#include "tarsier/media/image_file.h"

#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>
#include <string>

int main(int argc, char** argv) try {
  if (argc != 3) {
    std::fprintf(stderr, "usage: face_annotate SET IMAGE\n");
    return 2;
  }
  tarsier::face::ProposalRequest request;
  if (std::string(argv[1]).ends_with(".json")) {
    request.annotated = tarsier::face::shape::read_landmark_set(argv[1]);
  } else {
    const cv::Mat image = tarsier::read_gray_image(argv[1]);
    request.annotated.samples.resize(1);
    request.annotated.samples[0].image = argv[1];
    request.annotated.samples[0].points.resize(2, 5);
    request.annotated.samples[0].points << 0.45, 0.55, 0.5, 0.45, 0.55, 0.45, 0.45, 0.5, 0.55, 0.55;
    request.annotated.samples[0].points.row(0) *= image.cols;
    request.annotated.samples[0].points.row(1) *= image.rows;
  }
  request.gray = tarsier::read_gray_image(argv[2]);
  const auto proposal = tarsier::face::Annotator().propose(request);
  std::printf("%s\n", proposal ? to_json(*proposal).dump().c_str() : "null");
  return proposal ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "face_annotate: %s\n", error.what());
  return 1;
}
