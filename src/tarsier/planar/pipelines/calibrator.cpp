// SPDX-License-Identifier: MIT
#include "tarsier/planar/pipelines/calibrator.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <utility>

namespace tarsier::planar {
namespace {

using calibration::BoardView;
using calibration::ViewDecision;
using calibration::ViewState;

constexpr std::size_t kMaxImagesWithoutBoard =
    3;  // images in which boards of other sizes are searched
// Live mode: frames without a board before the search rate is reduced.
constexpr int kSparseSearchAfterFrames = 15;
constexpr int kSparseSearchEvery = 3;  // live mode: then every third frame is searched
constexpr int kSearchesPerLightMode =
    3;                              // live mode: failed searches before the light mode changes
constexpr double kDefaultFps = 25;  // of a source that does not state its rate

CalibrationImage image_of(const CalibratorState& state) {
  const Frame& frame = state.frame;
  CalibrationImage image;
  image.name = frame.name;
  image.index = frame.index;
  image.time = frame.time;
  image.still = frame.still;
  image.ms = state.ms;
  return image;
}

// A camera has one image size: the most frequent one.
cv::Size dominant_size(const CalibratorState& state) {
  std::map<std::pair<int, int>, int> counts;
  for (const cv::Size& size : state.sizes) ++counts[{size.width, size.height}];
  cv::Size best = state.size;
  int max_count = 0;
  for (const auto& [size, count] : counts) {
    if (count <= max_count) continue;
    max_count = count;
    best = {size.first, size.second};
  }
  return best;
}

const char* reason_of(ViewState state) {
  switch (state) {
    case ViewState::kUsed:
      return "";
    case ViewState::kNoPose:
      return "the board has no pose";
    case ViewState::kOutlier:
      break;
  }
  return "does not fit the other views";
}

}  // namespace

void CalibratorOptions::check() const {
  check_fields(*this);
  board.check();
  calibrate.check();
  collect.check();
}

CalibratorOptions live_calibrator_options() {
  CalibratorOptions options;
  options.live = true;
  options.search_px = 480;
  options.collect.still_px = 2;
  return options;
}

std::vector<BoardView> CalibrationResult::used_views() const {
  std::vector<BoardView> used;
  for (std::size_t i = 0; i < views.size(); ++i)
    if (!ok() || calibration.views[i].state == ViewState::kUsed) used.push_back(views[i]);
  return used;
}

Calibrator::Calibrator(const CalibratorOptions& options) : options_(options) { options.check(); }

Calibrator Calibrator::load(const CalibratorOptions& options) { return Calibrator(options); }

calibration::ViewCollector Calibrator::collector_for(cv::Size size) const {
  calibration::CollectorOptions collect = options_.collect;
  collect.still_px *= std::max(1.0, std::max(size.width, size.height) / 640.0);
  return {options_.board, size, collect};
}

void Calibrator::find_board_in(const Frame& frame, CalibratorState& state) const {
  const auto start = std::chrono::steady_clock::now();
  calibration::FindOptions find;
  find.search_px = options_.search_px;
  find.retry = !options_.live || frame.still;
  find.even_light = options_.live && !frame.still && state.even_light;
  state.board = calibration::find_board(frame.image, options_.board, find);
  const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - start;
  state.ms = spent.count();
}

CalibratorAnswer Calibrator::process(const Frame& frame, CalibratorState& state) const {
  TARSIER_REQUIRE(!frame.image.empty(), "an image without pixels");
  if (state.size.empty()) state.size = frame.image.size();
  state.frame = frame;
  state.board = {};
  if (options_.live) return process_live(frame, state);
  find_board_in(frame, state);
  if (!frame.still) {
    const std::string source = source_of(frame);
    if (!state.collector || source != state.source) {
      state.collector = collector_for(frame.image.size());
      state.accepted_images.clear();
    }
    state.source = source;
    state.sharpness = calibration::sharpness_of(frame.image, state.board, options_.board);
    return accept(state.collector->offer(state.board, state.sharpness), state);
  }
  CalibrationImage image = image_of(state);
  image.found = !state.board.empty();
  if (image.found) {
    image.view = state.views.size();
    state.views.push_back(state.board);
    state.sizes.push_back(frame.image.size());
  } else {
    image.reason = name_of(ViewDecision::kNoBoard);
    if (state.images_without_board.size() < kMaxImagesWithoutBoard)
      state.images_without_board.push_back(frame.image.clone());
  }
  const ViewDecision decision = image.found ? ViewDecision::kAccepted : ViewDecision::kNoBoard;
  state.images.push_back(std::move(image));
  return {state.board, decision};
}

CalibratorAnswer Calibrator::process_live(const Frame& frame, CalibratorState& state) const {
  if (!state.collector) state.collector = collector_for(state.size);
  if (frame.image.size() != state.size) return {};
  const bool waits = !frame.still && state.frames_without_board >= kSparseSearchAfterFrames;
  if (waits && state.frames_without_board % kSparseSearchEvery != 0) {
    ++state.frames_without_board;
    return {{}, ViewDecision::kNoBoard};
  }
  find_board_in(frame, state);
  const bool empty = state.board.empty();
  state.frames_without_board = empty ? state.frames_without_board + 1 : 0;
  state.searches_without_board = empty ? state.searches_without_board + 1 : 0;
  if (state.searches_without_board > 0 && state.searches_without_board % kSearchesPerLightMode == 0)
    state.even_light = !state.even_light;
  state.sharpness = calibration::sharpness_of(frame.image, state.board, options_.board);
  return accept(state.collector->offer(state.board, state.sharpness, frame.still), state);
}

CalibratorAnswer Calibrator::accept(const calibration::ViewCollector::Answer& answer,
                                    CalibratorState& state) const {
  CalibratorAnswer result{state.board, answer.decision};
  CalibrationImage image = image_of(state);
  if (!result.is_accepted()) {
    if (options_.live) return result;
    image.reason = name_of(answer.decision);
    if (answer.decision == ViewDecision::kNoBoard &&
        state.images_without_board.size() < kMaxImagesWithoutBoard)
      state.images_without_board.push_back(state.frame.image.clone());
    state.images.push_back(std::move(image));
    return result;
  }
  image.found = true;
  if (options_.keep_images && !image.still) image.image = state.frame.image.clone();
  if (answer.decision == ViewDecision::kAccepted) {
    image.view = state.views.size();
    state.views.push_back(state.board);
    state.sizes.push_back(state.collector->coverage().size);
    state.accepted_images.push_back(state.images.size());
    state.images.push_back(std::move(image));
    return result;
  }
  std::size_t& image_index = state.accepted_images[answer.index];
  CalibrationImage& before = state.images[image_index];
  image.view = before.view;
  state.views[image.view] = state.board;
  if (options_.live) {
    before = std::move(image);
    return result;
  }
  before.found = false;
  before.reason = name_of(ViewDecision::kTooSimilar);
  before.image.release();
  image_index = state.images.size();
  state.images.push_back(std::move(image));
  return result;
}

void Calibrator::search(FrameSource& source, CalibratorState& state, Progress& progress,
                        const std::stop_token& stop) const {
  const double fps = source.fps() > 0 ? source.fps() : kDefaultFps;
  const auto step =
      options_.every * std::max<std::int64_t>(1, std::lround(options_.examine_every_s * fps));
  state.collector.reset();
  progress.begin("calibrate", source.count(), "images");
  while (!source.ended()) {
    throw_if_stopped(stop);
    const auto frame = source.next(std::chrono::milliseconds(200), stop);
    throw_if_stopped(stop);
    if (!frame) continue;
    progress.advance();
    if (frame->still || frame->index % step == 0) process(*frame, state);
  }
  progress.end();
}

CalibratorAnswer Calibrator::take(CalibratorState& state) const {
  TARSIER_REQUIRE(options_.live, "only live views are taken whatever they are");
  if (state.board.empty()) return {{}, ViewDecision::kNoBoard};
  if (static_cast<int>(state.views.size()) >= options_.collect.max_views)
    return {state.board, ViewDecision::kFull};
  return accept(state.collector->force(state.board, state.sharpness), state);
}

void Calibrator::forget_last(CalibratorState& state) const {
  if (state.views.empty()) return;
  const std::size_t last = state.views.size() - 1;
  const auto image =
      std::find_if(state.images.begin(), state.images.end(),
                   [&](const CalibrationImage& one) { return one.found && one.view == last; });
  const auto at = static_cast<std::size_t>(image - state.images.begin());
  if (!state.accepted_images.empty() && state.accepted_images.back() == at) {
    state.collector->undo();
    state.accepted_images.pop_back();
  }
  state.views.pop_back();
  state.sizes.pop_back();
  if (options_.live) {
    state.images.erase(image);
  } else {
    image->found = false;
    image->reason = "forgotten";
    image->image.release();
  }
}

CalibrationResult Calibrator::calibrate(const CalibratorState& state,
                                        const std::optional<geometry::Camera>& start,
                                        const std::stop_token& stop) const {
  TARSIER_REQUIRE(!state.size.empty(), "no image was processed");
  CalibrationResult result;
  result.board = options_.board;
  result.images = state.images;
  result.views = state.views;
  result.size = dominant_size(state);
  for (CalibrationImage& image : result.images) {
    if (!image.found || state.sizes[image.view] == result.size) continue;
    const cv::Size& other = state.sizes[image.view];
    image.reason = fmt::format("{}x{} px, most others have {}x{}", other.width, other.height,
                               result.size.width, result.size.height);
    result.views[image.view] = {};
  }
  calibration::CalibrateOptions how = options_.calibrate;
  if (start) how.start = start;
  result.calibration = calibration::calibrate(result.views, options_.board, result.size, how, stop);
  if (result.ok()) {
    for (CalibrationImage& image : result.images)
      if (image.reason.empty())
        image.reason = reason_of(result.calibration.views[image.view].state);
  }
  result.coverage = coverage_of(result.used_views(), options_.board, result.size);
  return result;
}

std::optional<std::string> Calibrator::other_board(const CalibratorState& state) const {
  std::map<std::string, int> sizes;
  for (const cv::Mat& image : state.images_without_board)
    for (const std::string& size : calibration::other_chess_sizes(image, options_.board))
      ++sizes[size];
  // A part of a board may look like a smaller board, so the score also counts the points.
  std::optional<std::string> best;
  int best_score = 0;
  for (const auto& [size, count] : sizes) {
    const int points = calibration::parse_board("chess:" + size, options_.board.pitch).points();
    if (count * points <= best_score) continue;
    best_score = count * points;
    best = size;
  }
  return best;
}

}  // namespace tarsier::planar
