// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/shape/show.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/view/animation.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "demo.h"
#include "verbs/landmarks/engine.h"
#include "verbs/program/sample_images.h"
#include <filesystem>

namespace tarsier::cli {
namespace {

constexpr const char* kFaceImages[] = {"messi5.jpg"};

}  // namespace

void demo_landmarks(Context& context, DemoPage& page) {
  const face::LandmarkTracker tracker = load_landmark_tracker({});
  const face::shape::ShapeModel& shape_model = tracker.model().shape;
  face::LandmarkState state;
  page.begin_area(
      "Facial landmarks",
      "68 landmarks of each face, by regression trees and a cascade of linear regressions. Both "
      "were trained by this program. The images are real, from Debian's package opencv-doc.");
  page.command(fmt::format("tarsier landmarks fit {} -o points.png", sample_image("messi5.jpg")));
  std::vector<DemoImage> faces;
  for (const char* name : kFaceImages) {
    throw_if_stopped(context.stop);
    const std::filesystem::path path = sample_image(name);
    if (!std::filesystem::exists(path)) continue;
    Frame frame;
    frame.image = read_image(path.string());
    frame.still = true;
    const cv::Mat& image = frame.image;
    const std::vector<face::landmarks::TrackedFace> found = tracker.process(frame, state).faces;
    if (found.empty()) continue;
    // The face, enlarged, because it is small in its image.
    const cv::Rect2d& box = found.front().box;
    const cv::Rect around =
        cv::Rect(cvRound(box.x - 0.6 * box.width), cvRound(box.y - 0.4 * box.height),
                 cvRound(2.2 * box.width), cvRound(2.0 * box.height)) &
        cv::Rect(0, 0, image.cols, image.rows);
    const double zoom = 480.0 / around.width;
    cv::Mat enlarged;
    cv::resize(image(around), enlarged, {}, zoom, zoom, cv::INTER_CUBIC);
    Eigen::Matrix2Xd points = found.front().points;
    points.row(0) = ((points.row(0).array() - around.x + 0.5) * zoom - 0.5).matrix();
    points.row(1) = ((points.row(1).array() - around.y + 0.5) * zoom - 0.5).matrix();
    face::shape::LandmarkStyle style;
    style.radius_px = 2.5;
    face::shape::draw_landmarks(enlarged, points, shape_model.connections, shape_model.mirror,
                                style);
    faces.push_back(page.image("landmarks-" + path.stem().string(), enlarged,
                               fmt::format("{}: face of {:.0f} px width, score {:.2f}", name,
                                           box.width, found.front().score)));
  }
  if (faces.empty()) {
    page.note(
        "No images: the package opencv-doc is not installed. Install it and run the demo again.");
  } else {
    page.grid(faces);
  }

  page.heading("Shape modes",
               "The first modes of the shape model show the largest variations among a thousand "
               "faces, without position, scale and rotation. The faces are synthetic.");
  page.command("tarsier landmarks show landmarks68.json -o modes.gif");
  const std::vector<cv::Mat> frames =
      face::shape::animate_modes(shape_model, 4, cv::Size(360, 360), 24);
  const std::string file = page.path_of("landmarks-modes.gif");
  sfm::write_gif(file, frames, 12);
  page.grid(
      {DemoImage{"img/landmarks-modes.gif", "four modes, at -3 to 3 standard deviations", 360, 360},
       page.drawing("landmarks-modes", face::shape::draw_modes(shape_model, 4, 150),
                    "one mode per row")});
}

}  // namespace tarsier::cli
