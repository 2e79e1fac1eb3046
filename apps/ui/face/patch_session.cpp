// SPDX-License-Identifier: MIT
#include "ui/face/patch_session.h"

#include "tarsier/core/require.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/image/draw/tile.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "ui/overlay.h"
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {

namespace {

const cv::Size kView(1000, 620);
const cv::Rect kFaceArea(12, 12, 480, 522);
const cv::Rect kPatchArea(508, 34, 480, 228);
const cv::Rect kImageArea(508, 300, 480, 240);
const cv::Rect kPreviousButton(12, 544, 110, 28);
const cv::Rect kNextButton(130, 544, 110, 28);
constexpr int kSearchSizes[] = {11, 21, 31, 41};

void label(cv::Mat& image, const std::string& text, cv::Point at) {
  image::draw::TextStyle style;
  style.height_px = 9;
  style.backing = image::draw::Backing::kNone;
  image::draw::put_text(image, text, at, style);
}

}  // namespace

PatchSession::PatchSession(face::regression::PatchModels model, face::shape::ShapeModel shape,
                           std::optional<PatchImage> image)
    : model_(std::move(model)), shape_(std::move(shape)), image_(std::move(image)) {
  model_.check();
  TARSIER_REQUIRE(shape_.points() == model_.points(), "{} patches, a shape of {} points",
                  model_.points(), shape_.points());
  compute_responses();
  (void)view();  // clicks refer to the last drawn view
}

void PatchSession::compute_responses() {
  if (!image_) return;
  responses_ = face::regression::point_responses(model_, image_->gray, image_->points, search_);
}

std::vector<Action> PatchSession::actions() const {
  std::vector<Action> actions = {{"next", "next patch (right arrow, space)", 'n'},
                                 {"previous", "previous patch (left arrow)", 'p'}};
  if (image_) actions.push_back({"search", "widen the search region, then reset it", 'w'});
  return controls_.append_to(std::move(actions));
}

int PatchSession::patch_at(double x, double y) const {
  if (!face_.contains(cv::Point(static_cast<int>(x), static_cast<int>(y)))) return -1;
  const double margin = model_.side() / 2 + 3;
  const Eigen::Vector2d low = model_.reference.rowwise().minCoeff().array() - margin;
  const Eigen::Vector2d at(low.x() + (x - face_.x) / face_scale_,
                           low.y() + (y - face_.y) / face_scale_);
  Eigen::Index nearest = 0;
  (model_.reference.colwise() - at).colwise().squaredNorm().minCoeff(&nearest);
  return static_cast<int>(nearest);
}

void PatchSession::click(double x, double y) {
  const cv::Point at(static_cast<int>(x), static_cast<int>(y));
  const int count = model_.points();
  if (kNextButton.contains(at)) current_ = (current_ + 1) % count;
  if (kPreviousButton.contains(at)) current_ = (current_ + count - 1) % count;
  const int hit = patch_at(x, y);
  if (hit >= 0) current_ = hit;
}

View PatchSession::on_event(const Event& event) {
  if (event.kind == Event::Kind::kMouse) {
    if (event.mouse == Event::Mouse::kLeftDown) click(event.x, event.y);
    return view();
  }
  const std::string name = action_of(event, actions());
  const int count = model_.points();
  if (name == "next") current_ = (current_ + 1) % count;
  if (name == "previous") current_ = (current_ + count - 1) % count;
  if (name == "search" && image_) {
    const auto* wider = std::upper_bound(std::begin(kSearchSizes), std::end(kSearchSizes), search_);
    search_ = wider == std::end(kSearchSizes) ? kSearchSizes[0] : *wider;
    compute_responses();
  }
  controls_.act(name);
  return view();
}

void PatchSession::draw_face() {
  constexpr int kZoom = 4;
  const cv::Mat face = face::regression::draw_patches(model_, shape_, current_, kZoom);
  const double scale = std::min(static_cast<double>(kFaceArea.width) / face.cols,
                                static_cast<double>(kFaceArea.height) / face.rows);
  const cv::Size size(cvRound(face.cols * scale), cvRound(face.rows * scale));
  face_ = {kFaceArea.x + (kFaceArea.width - size.width) / 2,
           kFaceArea.y + (kFaceArea.height - size.height) / 2, size.width, size.height};
  face_scale_ = scale * kZoom;
  cv::Mat to = shown_(face_);
  cv::resize(face, to, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
}

void PatchSession::draw_patch() {
  const cv::Mat patch = face::regression::draw_patch(model_, current_, kPatchArea.height);
  image::draw::letterbox(patch, kPatchArea.size(), kBackground).copyTo(shown_(kPatchArea));
  label(shown_, fmt::format("weights of patch {}", current_), {kPatchArea.x, 14});
  label(shown_, "gradient of the weights", {kPatchArea.x + kPatchArea.width / 2 + 14, 14});
}

void PatchSession::draw_image() {
  if (!image_) {
    label(shown_, "--on IMAGE shows the response there", {kImageArea.x, kImageArea.y - 20});
    return;
  }
  const face::regression::PointResponse& response = responses_[static_cast<std::size_t>(current_)];
  const cv::Mat drawn = face::regression::draw_response(response, kImageArea.height);
  drawn.copyTo(shown_(cv::Rect(kImageArea.tl(), drawn.size())));
  label(shown_, fmt::format("image, {0}x{0} px", search_), {kImageArea.x, kImageArea.y - 20});
  label(shown_, fmt::format("response, maximum {:.2f}", response.best),
        {kImageArea.x + drawn.cols / 2 + 4, kImageArea.y - 20});
}

View PatchSession::view() {
  shown_.create(kView, CV_8UC3);
  shown_.setTo(kBackground);
  draw_face();
  draw_patch();
  draw_image();
  image::draw::button(shown_, kPreviousButton, "previous");
  image::draw::button(shown_, kNextButton, "next");
  View result;
  result.status = fmt::format("patch {} of {}, {}x{} px", current_ + 1, model_.points(),
                              model_.side(), model_.side());
  if (image_) result.status += ", on " + image_->name;
  if (draws_status()) {
    image::draw::status_bar(shown_, result.status, "h: help");
    if (controls_.help()) draw_help(shown_, "Patches", actions());
  }
  result.image = shown_;
  result.finished = controls_.finished();
  result.state = {{"patch", current_},
                  {"patches", model_.points()},
                  {"image", image_ ? nlohmann::json(image_->name) : nlohmann::json()},
                  {"search", search_},
                  {"response", nullptr},
                  {"peak", nullptr},
                  {"help", controls_.help()}};
  if (image_) {
    const face::regression::PointResponse& response =
        responses_[static_cast<std::size_t>(current_)];
    result.state["response"] = response.best;
    result.state["peak"] = {response.peak.x - search_ / 2, response.peak.y - search_ / 2};
  }
  return result;
}

}  // namespace tarsier
