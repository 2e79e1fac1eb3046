// SPDX-License-Identifier: MIT
#include "ui/plate/plate_session.h"

#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {
namespace {

const cv::Scalar kConfidentColor{80, 220, 80};
const cv::Scalar kUncertainColor{60, 180, 255};
const cv::Scalar kRegionColor{200, 200, 200};
constexpr std::size_t kMaxListedEvents = 4;
constexpr double kMinConfidence = 0.8;

void outline(cv::Mat& image, const plate::Quad& quad, const cv::Scalar& color, int width) {
  std::vector<cv::Point> points;
  for (const cv::Point2f& p : quad) points.emplace_back(cvRound(p.x * 16), cvRound(p.y * 16));
  cv::polylines(image, points, true, color, width, cv::LINE_AA, 4);
}

void label(cv::Mat& image, const cv::Rect& box, const std::string& text, const cv::Scalar& color) {
  image::draw::TextStyle style;
  style.height_px = std::clamp(box.height * 0.45, 9.0, 40.0);
  style.color = color;
  style.backing = image::draw::Backing::kBox;
  style.bold = true;
  const bool room_above = box.y > style.height_px * 2.2;
  image::draw::put_text(
      image, text, {box.x, room_above ? box.y - 2 : box.br().y + 2}, style,
      room_above ? image::draw::Anchor::kBottomLeft : image::draw::Anchor::kTopLeft);
}

std::string caption(const std::string& text, double confidence) {
  return text.empty() ? "?" : fmt::format("{} {:.0f}%", text, 100 * confidence);
}

}  // namespace

PlateSession::PlateSession(plate::VideoReader reader, OnPlate on_plate, MomentOf moment_of,
                           DebugSink* debug)
    : FrameSession("Number plates"),
      reader_(std::move(reader)),
      on_plate_(std::move(on_plate)),
      moment_of_(std::move(moment_of)),
      debug_(debug) {}

void PlateSession::process(const Frame& frame) {
  // Before the clock starts for another source.
  if (!plate::VideoReader::continues(frame, state_)) finish();
  const plate::FrameMoment seen =
      moment_of_ && !frame.still ? moment_of_(frame) : plate::FrameMoment{};
  result_ = reader_.process(frame, state_, seen, watched(debug_));
}

void PlateSession::on_processed() { report(result_.events); }

bool PlateSession::idle() {
  if (source().state == SourceState::kLive || frame().empty() || still()) return false;
  plate::VideoReaderResult silence =
      reader_.process_silence(latest().time + source().age_s, state_);
  const bool changed = !silence.events.empty() || silence.tracks.size() != tracks().size();
  result_.tracks = std::move(silence.tracks);
  report(silence.events);
  return changed;
}

bool PlateSession::act(const std::string& name) {
  if (name != "characters") return false;
  characters_ = !characters_;
  return true;
}

std::vector<Action> PlateSession::own_actions() const {
  return {{"characters", "show character boxes", 'c'}};
}

void PlateSession::finish() {
  report(reader_.finish(state_));
  result_.tracks.clear();
}

void PlateSession::shift_unsynchronized(std::chrono::milliseconds by) {
  plate::shift_unsynchronized(state_.tracker, by);
}

void PlateSession::report(const std::vector<plate::PlateEvent>& events) {
  for (const plate::PlateEvent& event : events) {
    if (on_plate_) on_plate_(event);
    if (event.state != plate::PlateState::kClosed) continue;
    ++events_;
    last_events_.push_back(fmt::format("{}  {:.1f}-{:.1f} s", caption(event.text, event.confidence),
                                       event.first_time, event.last_time));
    if (last_events_.size() > kMaxListedEvents) last_events_.erase(last_events_.begin());
  }
}

void PlateSession::draw(cv::Mat& image) {
  const int width = std::max(1, cvRound(std::min(image.cols, image.rows) / 400.0));
  const plate::Region& region = reader_.options().region;
  if (!region.corners.empty())
    cv::polylines(image, region.outline(image.size()), true, kRegionColor, width, cv::LINE_AA);
  for (const plate::Reading& reading : readings()) {
    const bool confident = reading.confidence >= kMinConfidence;
    if (characters_ && reading.box.height > 24) {
      for (const plate::Character& character : reading.characters)
        outline(image, character.corners,
                character.confidence >= kMinConfidence ? kConfidentColor : kUncertainColor, 1);
    }
    outline(image, reading.corners, confident ? kConfidentColor : kUncertainColor, 2 * width);
    if (still())
      label(image, reading.box, caption(reading.text, reading.confidence),
            confident ? kConfidentColor : kUncertainColor);
  }
  for (const plate::LiveTrack& track : tracks()) {
    if (!track.confirmed) continue;
    label(image, track.box, caption(track.text, track.confidence),
          track.confidence >= kMinConfidence ? kConfidentColor : kUncertainColor);
  }
  if (still()) return;
  image::draw::TextStyle style;
  style.height_px = std::max(9.0, image::draw::fitting_text_height(image.size()) * 0.7);
  int y = 6;
  for (const std::string& line : last_events_)
    y = image::draw::put_text(image, line, {6, y}, style).br().y;
}

nlohmann::json PlateSession::state() const {
  return {{"plates", readings().size()}, {"events", events_}};
}

std::string PlateSession::status() const { return count_text(readings().size(), "plate"); }

}  // namespace tarsier
