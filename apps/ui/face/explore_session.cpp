// SPDX-License-Identifier: MIT
#include "ui/face/explore_session.h"

#include "tarsier/core/require.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "ui/face/mode_sliders.h"
#include "ui/overlay.h"
#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

namespace tarsier {
namespace {

constexpr double kStep = 0.1;        // of a slider
constexpr double kKeyStep = 0.25;    // per key press
constexpr int kMaxShownSliders = 4;  // for shape and for look, if the sliders are below the image
constexpr double kRandomSpread = 0.7;
const cv::Size kPortrait(560, 560);
constexpr int kMaxExploredSide = 900;  // px, larger images are reduced

// Adds space for the status below.
cv::Mat framed(const cv::Mat& image) {
  cv::Mat whole(image.rows + kStatusHeight, image.cols, CV_8UC3, kBackground);
  image.copyTo(whole(cv::Rect(0, 0, image.cols, image.rows)));
  return whole;
}

std::vector<double> numbers(const Eigen::VectorXd& v) { return {v.data(), v.data() + v.size()}; }

}  // namespace

ExploreSession::ExploreSession(const face::appearance::AppearanceModel& model,
                               std::optional<ExploredImage> image, std::uint64_t seed)
    : model_(model),
      synthesis_(model),
      base_(std::move(image)),
      shape_(Eigen::VectorXd::Zero(model.shape.mode_count())),
      appearance_(Eigen::VectorXd::Zero(synthesis_.texture().mode_count())),
      seed_(seed) {
  if (!base_) return;
  TARSIER_REQUIRE(base_->points.cols() == model.points(), "{} points, the model has {}",
                  base_->points.cols(), model.points());
  const int longest = std::max(base_->image.cols, base_->image.rows);
  if (longest > kMaxExploredSide) {
    const double scale = static_cast<double>(kMaxExploredSide) / longest;
    cv::Mat reduced;
    cv::resize(base_->image, reduced, {}, scale, scale, cv::INTER_AREA);
    base_->image = reduced;
    base_->points = ((base_->points.array() + 0.5) * scale - 0.5).matrix();
  }
  image_shape_ = face::shape::fit_shape(model.shape, base_->points);
  image_appearance_ = synthesis_.fit_texture(base_->image, base_->points);
  over_image_ = true;
  reset_to_image();
}

void ExploreSession::reset_to_image() {
  shape_ = image_shape_.b.cwiseQuotient(model_.shape.deviation);
  appearance_ = image_appearance_.c.cwiseQuotient(synthesis_.texture().deviation);
}

double* ExploreSession::value_of(const std::string& name) {
  const std::size_t space = name.find(' ');
  if (space == std::string::npos) return nullptr;
  int number = 0;
  const char* end = name.data() + name.size();
  if (std::from_chars(name.data() + space + 1, end, number).ptr != end) return nullptr;
  const std::string kind = name.substr(0, space);
  Eigen::VectorXd* values = kind == "shape" ? &shape_ : kind == "look" ? &appearance_ : nullptr;
  if (values == nullptr || number < 1 || number > values->size()) return nullptr;
  return values->data() + (number - 1);
}

std::string ExploreSession::mode_name() const {
  const int shapes = static_cast<int>(shape_.size());
  return mode_ < shapes ? fmt::format("shape {}", mode_ + 1)
                        : fmt::format("look {}", mode_ - shapes + 1);
}

View ExploreSession::on_event(const Event& event) {
  if (event.kind == Event::Kind::kSlider) {
    if (double* value = value_of(event.name); value != nullptr)
      *value = std::clamp(event.value, -kMaxSigmas, kMaxSigmas);
    return view();
  }
  const std::string name = action_of(event, actions());
  const int modes = static_cast<int>(shape_.size() + appearance_.size());
  if (name == "mean") {
    shape_.setZero();
    appearance_.setZero();
  }
  if (name == "random") {
    const face::appearance::RandomFace face =
        face::appearance::random_face(model_, synthesis_.texture(), seed_++, kRandomSpread);
    shape_ = face.b.cwiseQuotient(model_.shape.deviation);
    appearance_ = face.c.cwiseQuotient(synthesis_.texture().deviation);
  }
  if (name == "image" && base_) reset_to_image();
  if (name == "over" && base_) over_image_ = !over_image_;
  if (name == "mesh") mesh_ = !mesh_;
  if ((name == "next" || name == "previous") && modes > 0)
    mode_ = (mode_ + (name == "next" ? 1 : modes - 1)) % modes;
  if (name == "more" || name == "less") {
    if (double* value = value_of(mode_name()); value != nullptr)
      *value =
          std::clamp(*value + (name == "more" ? kKeyStep : -kKeyStep), -kMaxSigmas, kMaxSigmas);
  }
  controls_.act(name);
  return view();
}

std::vector<Action> ExploreSession::actions() const {
  std::vector<Action> list{{"mean", "show the mean face", '0'},
                           {"random", "show a random face", 'r'}};
  if (base_) {
    list.push_back({"image", "show the face of the image", 'f'});
    list.push_back({"over", "draw over the image or alone", 'o'});
  }
  list.push_back({"mesh", "show the mesh", 'm'});
  list.push_back({"next", "next mode", 'n'});
  list.push_back({"previous", "previous mode", 'p'});
  list.push_back({"more", "add 1/4 standard deviation of the mode", '+'});
  list.push_back({"less", "subtract 1/4 standard deviation", '-'});
  return controls_.append_to(std::move(list));
}

std::vector<Slider> ExploreSession::sliders() const {
  std::vector<Slider> list;
  for (const auto& [kind, values] :
       {std::pair{"shape", &shape_}, std::pair{"look", &appearance_}}) {
    const int all = static_cast<int>(values->size());
    for (int k = 0; k < (draws_status() ? std::min(kMaxShownSliders, all) : all); ++k)
      list.push_back(
          {fmt::format("{} {}", kind, k + 1), -kMaxSigmas, kMaxSigmas, kStep, (*values)[k]});
  }
  return list;
}

cv::Mat ExploreSession::image() const {
  const Eigen::VectorXd b = shape_.cwiseProduct(model_.shape.deviation);
  const Eigen::VectorXd c = appearance_.cwiseProduct(synthesis_.texture().deviation);
  cv::Mat image;
  Eigen::Matrix2Xd points;
  if (over_image_) {
    image = base_->image.clone();
    points = image_shape_.image_from_model(face::shape::shape_of(model_.shape, b));
    synthesis_.draw(c, image_appearance_.offset, image_appearance_.gain, points, image);
  } else {
    image = synthesis_.portrait(b, c, kPortrait, &points);
  }
  if (mesh_) face::appearance::draw_mesh(model_, points, image);
  return image;
}

View ExploreSession::view() {
  View result;
  result.output = image();
  shown_ = draws_status() ? framed(result.output) : result.output;
  const std::string name = mode_name();
  const double* value = value_of(name);
  result.status = fmt::format("{}: {:+.2f} standard deviations; modes: {} shape, {} look", name,
                              value != nullptr ? *value : 0.0, shape_.size(), appearance_.size());
  if (draws_status()) {
    image::draw::status_bar(shown_, result.status, "h: help");
    if (controls_.help()) draw_help(shown_, "Appearance model", actions());
  }
  result.image = shown_;
  result.finished = controls_.finished();
  result.state = {{"shape", numbers(shape_)},
                  {"look", numbers(appearance_)},
                  {"mode", name},
                  {"over", over_image_},
                  {"mesh", mesh_},
                  {"help", controls_.help()}};
  return result;
}

ShapeSpaceSession::ShapeSpaceSession(face::shape::ShapeModel model,
                                     const std::vector<Eigen::Matrix2Xd>& shapes)
    : model_(std::move(model)), sigmas_(Eigen::VectorXd::Zero(model_.mode_count())) {
  for (const Eigen::Matrix2Xd& points : shapes) {
    aligned_.push_back(face::shape::fit_similarity(points, model_.mean)(points));
    scores_.push_back(
        face::shape::fit_shape(model_, points, {}, 10).b.cwiseQuotient(model_.deviation));
  }
}

View ShapeSpaceSession::on_event(const Event& event) {
  if (event.kind == Event::Kind::kSlider) {
    for (Eigen::Index k = 0; k < std::min<Eigen::Index>(2, sigmas_.size()); ++k) {
      if (event.name == fmt::format("mode {}", k + 1))
        sigmas_[k] = std::clamp(event.value, -kMaxSigmas, kMaxSigmas);
    }
    return view();
  }
  const std::string name = action_of(event, actions());
  if (name == "mean") sigmas_.setZero();
  if (name == "training") shows_training_shapes_ = !shows_training_shapes_;
  controls_.act(name);
  return view();
}

std::vector<Action> ShapeSpaceSession::actions() const {
  return controls_.append_to(
      {{"mean", "show the mean shape", '0'}, {"training", "show the training shapes", 't'}});
}

std::vector<Slider> ShapeSpaceSession::sliders() const {
  std::vector<Slider> list;
  for (Eigen::Index k = 0; k < std::min<Eigen::Index>(2, sigmas_.size()); ++k)
    list.push_back({fmt::format("mode {}", k + 1), -kMaxSigmas, kMaxSigmas, kStep, sigmas_[k]});
  return list;
}

cv::Mat ShapeSpaceSession::image() const {
  const cv::Size size(760, 560);
  cv::Mat image(size, CV_8UC3, kBackground);
  // The shapes at the left, their coordinates in the plane of the two modes at the right.
  const double left = 540;
  Eigen::Array2d low = model_.mean.rowwise().minCoeff().array();
  Eigen::Array2d high = model_.mean.rowwise().maxCoeff().array();
  for (const Eigen::Matrix2Xd& points : aligned_) {
    low = low.min(points.rowwise().minCoeff().array());
    high = high.max(points.rowwise().maxCoeff().array());
  }
  const double scale = 0.8 * std::min(left, static_cast<double>(size.height)) /
                       std::max(1e-9, (high - low).maxCoeff());
  const Eigen::Array2d center = (low + high) / 2;
  const auto to_pixel = [&](const Eigen::Vector2d& p) {
    const Eigen::Array2d at =
        scale * (p.array() - center) + Eigen::Array2d(left / 2, size.height / 2.0);
    return cv::Point2d(at.x(), at.y());
  };
  if (shows_training_shapes_) {
    for (const Eigen::Matrix2Xd& points : aligned_)
      for (Eigen::Index i = 0; i < points.cols(); ++i)
        image::draw::point(image, to_pixel(points.col(i)), {120, 110, 100}, 1.5);
  }
  const Eigen::Matrix2Xd made =
      face::shape::shape_of(model_, sigmas_.cwiseProduct(model_.deviation));
  for (const auto& line : model_.connections) {
    cv::line(image, to_pixel(made.col(line[0])), to_pixel(made.col(line[1])), {230, 200, 90}, 1,
             cv::LINE_AA);
  }
  for (Eigen::Index i = 0; i < made.cols(); ++i)
    image::draw::point(image, to_pixel(made.col(i)), {80, 220, 255}, 3.5);

  const cv::Rect plane(555, 180, 190, 190);
  cv::rectangle(image, plane, {90, 84, 78}, 1);
  const auto in_plane = [&](double a, double b) {
    const auto share = [](double v) {
      return (std::clamp(v, -kMaxSigmas, kMaxSigmas) + kMaxSigmas) / (2 * kMaxSigmas);
    };
    return cv::Point2d(plane.x + share(a) * plane.width, plane.y + (1 - share(b)) * plane.height);
  };
  const auto second = [](const Eigen::VectorXd& v) { return v.size() > 1 ? v[1] : 0.0; };
  if (shows_training_shapes_) {
    for (const Eigen::VectorXd& score : scores_)
      if (score.size() > 0)
        image::draw::point(image, in_plane(score[0], second(score)), {150, 140, 130}, 2);
  }
  if (sigmas_.size() > 0)
    image::draw::point(image, in_plane(sigmas_[0], second(sigmas_)), {80, 220, 255}, 5);
  image::draw::TextStyle style;
  style.height_px = 9;
  style.backing = image::draw::Backing::kNone;
  image::draw::put_text(image, "mode 1 and mode 2", {plane.x + plane.width / 2, plane.y - 16},
                        style, image::draw::Anchor::kCenter);
  return image;
}

View ShapeSpaceSession::view() {
  View result;
  result.output = image();
  shown_ = draws_status() ? framed(result.output) : result.output;
  result.status = fmt::format("{} points, {} shapes, {} modes", model_.points(), aligned_.size(),
                              model_.mode_count());
  if (draws_status()) {
    image::draw::status_bar(shown_, result.status, "h: help");
    if (controls_.help()) draw_help(shown_, "Shapes", actions());
  }
  result.image = shown_;
  result.finished = controls_.finished();
  result.state = {{"values", numbers(sigmas_)},
                  {"training", shows_training_shapes_},
                  {"help", controls_.help()}};
  return result;
}

}  // namespace tarsier
