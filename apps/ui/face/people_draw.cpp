// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/face/people/classical.h"
#include "tarsier/face/recognition/normalize.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/image/draw/tile.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "ui/face/people_session.h"
#include "ui/overlay.h"
#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

namespace tarsier {
namespace {

const cv::Scalar kGreen{80, 220, 80};
const cv::Scalar kRed{60, 60, 235};
const cv::Scalar kGrey{170, 170, 170};
constexpr int kStrip = 96;       // px, width of the strip at the right
constexpr int kStripThumb = 72;  // px, a face in it
constexpr int kCell = 98;        // px, distance of the faces
constexpr int kBar = 28;         // px, height of the status bar below
constexpr int kButtonWidth = 104;
constexpr int kButtonHeight = 30;
constexpr int kMinHeight = 420;  // px, smaller frames are enlarged
constexpr int kMaxHeight = 720;

constexpr std::array<const char*, 10> kPrompts{
    {"Look straight into the camera", "Turn a little to the left", "Look up a little",
     "Turn a little to the right", "Look down a little", "Tilt your head to the left",
     "Tilt your head to the right", "Smile", "Open your mouth", "Raise your eyebrows"}};

void put(cv::Mat& canvas, const cv::Mat& image, cv::Point at) {
  const cv::Rect box = cv::Rect(at, image.size()) & cv::Rect({0, 0}, canvas.size());
  if (!box.empty()) image(cv::Rect(box.tl() - at, box.size())).copyTo(canvas(box));
}

}  // namespace

double PeopleSession::scale() const {
  if (frame_.empty()) return 1;
  return std::clamp(static_cast<double>(frame_.rows), static_cast<double>(kMinHeight),
                    static_cast<double>(kMaxHeight)) /
         frame_.rows;
}

cv::Size PeopleSession::image_size() const {
  if (frame_.empty()) return {640, 480};
  return {std::max(1, cvRound(frame_.cols * scale())), std::max(1, cvRound(frame_.rows * scale()))};
}

cv::Rect PeopleSession::button_box(std::string_view name) const {
  const cv::Size size = image_size();
  const auto left = [&](int row) {
    return cv::Rect(10, 10 + row * (kButtonHeight + 8), kButtonWidth, kButtonHeight);
  };
  if (name == "add") return left(0);
  if (name == "delete") return left(1);
  if (name == "debug") return left(2);
  if (name == "confirm")
    return {size.width / 2 - kButtonWidth - 10, size.height / 2 + 10, kButtonWidth, kButtonHeight};
  if (name == "cancel")
    return {size.width / 2 + 10, size.height / 2 + 10, kButtonWidth, kButtonHeight};
  return {};
}

cv::Rect PeopleSession::strip_box(std::size_t person) const {
  const cv::Size size = image_size();
  // If there is no space for all, the newest are shown.
  const auto room = static_cast<std::size_t>(std::max(1, size.height / kCell));
  const std::size_t first = people_.size() > room ? people_.size() - room : 0;
  if (person < first || person >= people_.size()) return {};
  return {size.width + (kStrip - kStripThumb) / 2, 8 + static_cast<int>(person - first) * kCell,
          kStripThumb, kStripThumb};
}

// At the right of the buttons, above the prompts.
cv::Rect PeopleSession::panel_area() const {
  const cv::Size size = image_size();
  const int left = 10 + kButtonWidth + 10;
  return {left, 10, size.width - left - 10, size.height - 20};
}

std::string PeopleSession::prompt() const {
  if (mode_ != PeopleMode::kCollect) return "";
  if (faces_.empty()) return "No face in the image";
  return kPrompts[static_cast<std::size_t>(collector_.accepted()) % kPrompts.size()];
}

std::string PeopleSession::help_line() const {
  if (!message_.empty()) return message_;
  switch (mode_) {
    case PeopleMode::kStart:
      return "starting";
    case PeopleMode::kDetect:
      return "Click Add Person to enrol a person";
    case PeopleMode::kCollect:
      return fmt::format("Collecting faces of {}: {}. Click elsewhere to stop and train",
                         printable(people_[static_cast<std::size_t>(collecting_)].name),
                         collector_.accepted());
    case PeopleMode::kTrain:
      return "Training ..";
    case PeopleMode::kRecognize:
      break;
  }
  return "Click a face at the right to add images of it, or Add Person";
}

// "3 groups, 2 ungrouped faces   "; empty if there are none.
std::string PeopleSession::unknown_text() const {
  if (group_count_ == 0 && ungrouped_count_ == 0) return "";
  std::string out = count_text(static_cast<std::size_t>(group_count_), "group");
  if (ungrouped_count_ > 0)
    out += ", " + count_text(static_cast<std::size_t>(ungrouped_count_), "ungrouped face");
  return out + "   ";
}

void PeopleSession::draw_strip() {
  const int x = image_size().width;
  shown_.colRange(x, shown_.cols).setTo(kBackground);
  for (std::size_t i = 0; i < people_.size(); ++i) {
    const Enrolled& person = people_[i];
    const cv::Rect box = strip_box(i);
    if (box.empty()) continue;
    if (person.latest.empty()) {
      cv::rectangle(shown_, box, kGrey, 1);
      image::draw::put_text(shown_, "?", (box.tl() + box.br()) / 2, {.height_px = 24},
                            image::draw::Anchor::kCenter);
    } else {
      put(shown_, face_thumbnail(person.latest, kStripThumb), box.tl());
    }
    const bool seen =
        std::any_of(faces_.begin(), faces_.end(), [&](const face::IdentifiedFace& face) {
          return face.identity.known && face.identity.label == person.name;
        });
    const cv::Rect rim(box.x - 3, box.y - 3, box.width + 6, box.height + 6);
    if (static_cast<int>(i) == collecting_) cv::rectangle(shown_, rim, kRed, 3);
    if (seen) cv::rectangle(shown_, rim, kGreen, 3);
    std::string label = printable(person.name);
    if (label.size() > 11) label = label.substr(0, 10) + ".";
    image::draw::put_text(
        shown_, fmt::format("{} {}", label, person.faces), {x + kStrip / 2, box.br().y + 4},
        {.height_px = 8, .backing = image::draw::Backing::kNone}, image::draw::Anchor::kTop);
  }
}

void PeopleSession::draw_buttons() {
  image::draw::button(shown_, button_box("add"), "Add Person",
                      mode_ == PeopleMode::kCollect && !pending_.empty());
  image::draw::button(shown_, button_box("delete"), "Delete All", is_confirming_);
  image::draw::button(shown_, button_box("debug"), "Debug", debug_);
  if (!is_confirming_) return;
  const cv::Point center(image_size().width / 2, image_size().height / 2);
  image::draw::fill_rounded(shown_, {center.x - 210, center.y - 50, 420, 110}, 10, kBackground,
                            0.9);
  image::draw::put_text(shown_,
                        fmt::format("Delete {} people and all their faces?", people_.size()),
                        {center.x, center.y - 14}, {.height_px = 13}, image::draw::Anchor::kCenter);
  image::draw::button(shown_, button_box("confirm"), "Delete");
  image::draw::button(shown_, button_box("cancel"), "Keep", true);
}

// Shows the crop of the largest face as the recogniser sees it, at the top centre.
void PeopleSession::draw_preprocessed() {
  if (faces_.empty()) return;
  const cv::Mat& crop = faces_.front().face.crop;
  const face::recognition::Recognizer* model = identity_.recognizer();
  const bool general = model == nullptr || face::recognition::is_whitened(model->options.algorithm);
  cv::Mat seen = general ? face::recognition::light_image(face::recognition::tan_triggs(crop))
                         : face::people::classical_face(crop);
  const int height = 84;
  cv::resize(seen, seen, {cvRound(height * static_cast<double>(seen.cols) / seen.rows), height}, 0,
             0, cv::INTER_AREA);
  cv::cvtColor(seen, seen, cv::COLOR_GRAY2BGR);
  const cv::Point at(image_size().width / 2 - seen.cols / 2, 8);
  cv::rectangle(shown_, cv::Rect(at.x - 2, at.y - 2, seen.cols + 4, seen.rows + 4), kGrey, 2);
  put(shown_, seen, at);
}

// Shows the confidence for the largest face, with the threshold as a line.
void PeopleSession::draw_confidence() {
  if (mode_ != PeopleMode::kRecognize || faces_.empty() || faces_.front().identity.label.empty())
    return;
  const face::people::Recognition& name = faces_.front().identity;
  const cv::Size size = image_size();
  const cv::Rect box(size.width - 30, size.height / 2 - 90, 16, 180);
  image::draw::fill_rounded(shown_, box, 4, kBackground, 0.8);
  const int filled = cvRound(std::clamp(name.confidence, 0.0, 1.0) * box.height);
  cv::rectangle(shown_, cv::Rect(box.x, box.br().y - filled, box.width, filled),
                name.known ? kGreen : kGrey, cv::FILLED);
  const int line = box.br().y - box.height / 2;  // the threshold's position
  cv::line(shown_, {box.x - 5, line}, {box.br().x + 5, line}, cv::Scalar(255, 255, 255), 2);
  image::draw::put_text(shown_, fmt::format("{:.0f}%", 100 * name.confidence),
                        {box.br().x + 6, box.y - 4}, {.height_px = 10},
                        image::draw::Anchor::kBottomRight);
}

void PeopleSession::draw_debug() {
  if (!debug_ || faces_.empty()) return;
  struct Kept final : DebugSink {
    void image(std::string_view name, const cv::Mat& image) override {
      names.emplace_back(name);
      images.push_back(image.clone());
    }
    std::vector<std::string> names;
    std::vector<cv::Mat> images;
  } kept;
  const face::people::Face& face = faces_.front().face;
  kept.image("aligned", face.crop);
  (void)face::people::classical_face(face.crop, face::people::CropOptions(), {}, &kept);
  kept.image("illumination normalised",
             face::recognition::light_image(face::recognition::tan_triggs(face.crop)));
  const cv::Size size = image_size();
  const cv::Mat stages = image::draw::tile(kept.images, kept.names, {size.width - 20, 132});
  put(shown_, stages, {10, size.height - 142});
  std::string text =
      fmt::format("eyes {:.0f} px  sharp {:.2f}  turn {:+.2f}  tilt {:+.2f}  light {:.0f}",
                  face.quality.eye_distance, face.quality.sharpness, face.quality.turn,
                  face.quality.tilt, face.quality.light);
  for (const std::string& flaw :
       face::people::quality_problems(face.quality, options_.collect.gate))
    text += "  " + flaw;
  if (!faces_.front().identity.label.empty())
    text += fmt::format("  score {:.3f}, threshold {:.3f}", faces_.front().identity.score,
                        faces_.front().identity.threshold);
  image::draw::put_text(shown_, text, {10, size.height - 148}, {.height_px = 9},
                        image::draw::Anchor::kBottomLeft);
}

nlohmann::json PeopleSession::state() const {
  nlohmann::json people = nlohmann::json::array();
  for (const Enrolled& person : people_)
    people.push_back({{"name", person.name}, {"faces", person.faces}});
  nlohmann::json recognized = nlohmann::json::array();
  for (std::size_t i = 0; i < faces_.size(); ++i) {
    const face::people::Recognition& name = faces_[i].identity;
    recognized.push_back(
        {{"label", name.label.empty() ? nlohmann::json() : nlohmann::json(name.label)},
         {"known", name.known},
         {"confidence", name.confidence},
         {"group",
          i < groups_.size() && groups_[i] > 0 ? nlohmann::json(groups_[i]) : nlohmann::json()}});
  }
  nlohmann::json state{
      {"mode", name_of(mode_)},
      {"people", std::move(people)},
      {"collecting", collecting_ >= 0
                         ? nlohmann::json(people_[static_cast<std::size_t>(collecting_)].name)
                         : nlohmann::json()},
      {"recognized", std::move(recognized)},
      {"unknown", {{"groups", group_count_}, {"waiting", ungrouped_count_}}},
      {"panel", panel_.state()},
      {"asking", is_confirming_},
      {"debug", debug_},
      {"flash", flash_ > 0},
      {"message", message_},
      {"prompt", prompt()},
      {"paused", controls_.paused()}};
  if (!forgotten_.empty()) state["forgotten"] = forgotten_;
  return state;
}

View PeopleSession::view(bool fresh) {
  View result;
  result.state = state();
  result.status = help_line();
  result.finished = controls_.finished();
  const cv::Size size = image_size();
  shown_.create(size.height + (draws_status() ? kBar : 0), size.width + kStrip, CV_8UC3);
  shown_.setTo(kBackground);
  if (!frame_.empty()) {
    cv::Mat image = shown_(cv::Rect({0, 0}, size));
    if (fresh) {
      frame_.copyTo(output_);
      const auto group = [&](std::size_t i) { return i < groups_.size() ? groups_[i] : 0; };
      for (std::size_t i = 0; i < faces_.size(); ++i) draw_named_face(output_, faces_[i], group(i));
      if (mode_ != PeopleMode::kRecognize) {
        frame_.copyTo(output_);  // no names yet: only boxes and eyes
        for (std::size_t i = 0; i < faces_.size(); ++i) {
          const face::IdentifiedFace& face = faces_[i];
          if (group(i) > 0) {
            draw_named_face(output_, face, group(i));
            continue;
          }
          cv::rectangle(output_, face.face.box, cv::Scalar(255, 200, 0), 2, cv::LINE_AA);
          for (const cv::Point2d& eye : {face.face.eyes.left, face.face.eyes.right})
            cv::circle(output_, eye, std::max(2, cvRound(0.12 * face.face.eyes.distance())),
                       cv::Scalar(255, 200, 0), 1, cv::LINE_AA);
        }
      }
      result.output = output_;
    }
    if (!output_.empty())
      cv::resize(output_, image, size, 0, 0, scale() < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
    if (flash_ > 0) image.setTo(cv::Scalar::all(255));
  }
  draw_preprocessed();
  draw_confidence();
  draw_debug();
  draw_strip();
  draw_buttons();
  if (!is_confirming_) panel_.draw(shown_, panel_area());
  if (const std::string text = prompt(); !text.empty() && !is_confirming_)
    image::draw::put_text(shown_, text, {size.width / 2, size.height - 14},
                          {.height_px = 16, .backing = image::draw::Backing::kBox},
                          image::draw::Anchor::kBottom);
  if (draws_status()) {
    image::draw::status_bar(shown_, result.status,
                            source_.empty()
                                ? fmt::format("{}{}{}   h: help", unknown_text(), name_of(mode_),
                                              controls_.paused() ? ", paused" : "")
                                : source_);
    if (controls_.help()) draw_help(shown_, "People", actions());
  }
  result.image = shown_;
  return result;
}

}  // namespace tarsier
