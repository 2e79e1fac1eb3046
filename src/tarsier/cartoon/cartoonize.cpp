// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/cartoonize.h"

#include "tarsier/cartoon/bilateral.h"
#include "tarsier/cartoon/enlarge.h"
#include "tarsier/cartoon/kernels.h"
#include "tarsier/cartoon/plane.h"
#include "tarsier/cartoon/reference.h"
#include "tarsier/cartoon/rows.h"
#include "tarsier/cartoon/skin.h"
#include "tarsier/cartoon/stabilize.h"
#include "tarsier/core/image.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/detect/detector.h"

#include <opencv2/imgproc.hpp>

#include <array>
#include <cstring>
#include <map>
#include <optional>

namespace tarsier::cartoon {

struct CartoonState::Impl {
  cv::Size size;
  Plane gray;
  Plane smooth;    // gray after the median
  Plane response;  // of the line filter
  Plane raw_mask;  // lines before cleaning
  Plane marks;     // pepper
  Plane mask;
  std::vector<std::vector<std::uint8_t>> scratch;  // of median7_row, one per band of rows
  BilateralPainter painter;
  Enlarger enlarger;
  cv::Mat small;
  cv::Mat small_other;
  cv::Mat large;  // the painting at full size, if the output is another image
  cv::Mat output;
  SkinBuffers skin;
  Stabilizer lines;
  Stabilizer evil_lines;
  std::optional<face::FaceFollower> follower;
  std::map<int, SkinColor> skin_colors;  // by identity of the face
  std::vector<cv::Rect> faces;
};

CartoonState::CartoonState() : impl_(std::make_unique<Impl>()) {}
CartoonState::~CartoonState() = default;
CartoonState::CartoonState(CartoonState&&) noexcept = default;
CartoonState& CartoonState::operator=(CartoonState&&) noexcept = default;

void CartoonState::reset() {
  impl_->lines.reset();
  impl_->evil_lines.reset();
  if (impl_->follower) impl_->follower->reset();
  impl_->skin_colors.clear();
  impl_->faces.clear();
}

const std::vector<cv::Rect>& CartoonState::faces() const { return impl_->faces; }

namespace {

using State = CartoonState::Impl;

// Debug images and timers of one call; both optional.
class Watch {
 public:
  Watch(DebugSink* debug, Timers* timers) : debug_(debug), timers_(timers) {}

  void image(std::string_view name, const cv::Mat& image) const {
    if (debug_ != nullptr) debug_->image(name, image);
  }
  [[nodiscard]] Timers::Scope time(std::string_view name) const { return {timers_, name}; }
  [[nodiscard]] bool wants_images() const { return debug_ != nullptr; }

 private:
  DebugSink* debug_;
  Timers* timers_;
};

bool is_fast(const CartoonOptions& options) { return options.quality != Quality::kReference; }

// --- lines ---

void median7(State& state) {
  const Kernels& kernel = kernels();
  Plane& gray = state.gray;
  const int width = gray.width();
  const std::ptrdiff_t stride = gray.stride();
  state.scratch.resize(
      std::max(state.scratch.size(), static_cast<size_t>(number_of_bands(gray.height()))));
  for_row_bands(gray.height(), [&](int band, int first, int last) {
    std::vector<std::uint8_t>& scratch = state.scratch[static_cast<size_t>(band)];
    scratch.resize(static_cast<size_t>(7 * stride));
    for (int y = first; y < last; ++y) {
      const std::uint8_t* rows[7];
      for (int i = 0; i < 7; ++i) rows[i] = gray.row(y - 3 + i);
      kernel.median7_row(rows, state.smooth.row(y), width, scratch.data(), stride);
    }
  });
}

// Computes grey and median into state.smooth, with a mirrored margin for derivative filters.
void smooth_gray(const cv::Mat& frame, const CartoonOptions& options, State& state,
                 Stabilizer& steady, const Watch& watch) {
  const int size = options.sketch.median_size;
  state.gray.resize(frame.cols, frame.rows);
  state.smooth.resize(frame.cols, frame.rows);
  cv::Mat gray = state.gray.view();
  cv::Mat smooth = state.smooth.view();
  {
    const auto timer = watch.time("grey");
    cv::cvtColor(frame, gray, cv::COLOR_BGR2GRAY);
  }
  watch.image("grey", gray);
  {
    const auto timer = watch.time("median");
    if (is_fast(options) && size == 7) {
      for (int y = 0; y < frame.rows; ++y) state.gray.extend_row_by_copies(y, 3);
      state.gray.extend_height_by_copies(3);
      median7(state);
    } else {
      cv::medianBlur(gray, smooth, size);
    }
  }
  watch.image("median", smooth);
  if (options.steady.on) {
    const auto timer = watch.time("steady");
    steady.smooth(state.smooth, options.steady);
    watch.image("steady", smooth);
  }
}

void mirror_margin(Plane& plane, int margin) {
  for (int y = 0; y < plane.height(); ++y) plane.extend_row_by_reflection(y, margin);
  plane.extend_height_by_reflection(margin);
}

void line_response(const CartoonOptions& options, State& state, const Watch& watch) {
  const auto timer = watch.time("laplacian");
  state.response.resize(state.smooth.width(), state.smooth.height());
  if (is_fast(options) && options.sketch.laplacian_size == 5) {
    const Kernels& kernel = kernels();
    mirror_margin(state.smooth, 2);
    for_row_bands(state.smooth.height(), [&](int first, int last) {
      for (int y = first; y < last; ++y) {
        const std::uint8_t* const rows[5] = {state.smooth.row(y - 2), state.smooth.row(y - 1),
                                             state.smooth.row(y), state.smooth.row(y + 1),
                                             state.smooth.row(y + 2)};
        kernel.laplacian5_row(rows, state.response.row(y), state.smooth.width());
      }
    });
  } else {
    cv::Mat response = state.response.view();
    cv::Laplacian(state.smooth.view(), response, CV_8U, options.sketch.laplacian_size);
  }
  watch.image("laplacian", state.response.view());
}

void evil_response(const CartoonOptions& options, State& state, const Watch& watch) {
  const auto timer = watch.time("scharr");
  state.response.resize(state.smooth.width(), state.smooth.height());
  if (is_fast(options)) {
    const Kernels& kernel = kernels();
    mirror_margin(state.smooth, 1);
    for_row_bands(state.smooth.height(), [&](int first, int last) {
      for (int y = first; y < last; ++y) {
        const std::uint8_t* const rows[3] = {state.smooth.row(y - 1), state.smooth.row(y),
                                             state.smooth.row(y + 1)};
        kernel.scharr_row(rows, state.response.row(y), state.smooth.width(),
                          options.evil.both_axes);
      }
    });
  } else {
    reference::evil_response(state.smooth.view(), options.evil).copyTo(state.response.view());
  }
  watch.image("scharr", state.response.view());
}

// Thresholds state.response to lines in state.raw_mask.
void threshold_lines(int threshold, const SteadyOptions& steady, Stabilizer& stabilizer,
                     State& state, const Watch& watch) {
  const auto timer = watch.time("threshold");
  state.raw_mask.resize(state.response.width(), state.response.height());
  if (steady.on) {
    stabilizer.threshold(state.response, threshold, steady, state.raw_mask);
  } else {
    const Kernels& kernel = kernels();
    for_row_bands(state.response.height(), [&](int first, int last) {
      for (int y = first; y < last; ++y) {
        kernel.threshold_inverse_row(state.response.row(y), state.raw_mask.row(y),
                                     state.response.width(), threshold);
      }
    });
  }
  watch.image("threshold", state.raw_mask.view());
}

// Removes pepper noise from state.raw_mask; the result is state.mask.
void remove_pepper(const CartoonOptions& options, State& state, const Watch& watch) {
  const auto timer = watch.time("pepper");
  const int width = state.raw_mask.width();
  const int height = state.raw_mask.height();
  state.mask.resize(width, height);
  if (!options.sketch.remove_pepper || width < 5 || height < 5) {
    state.raw_mask.view().copyTo(state.mask.view());
    return;
  }
  if (!is_fast(options)) {
    cv::Mat mask = state.mask.view();
    state.raw_mask.view().copyTo(mask);
    reference::remove_pepper(mask);
    watch.image("pepper", mask);
    return;
  }
  const Kernels& kernel = kernels();
  state.marks.resize(width, height);
  for_row_bands(height, [&](int first, int last) {
    for (int y = first; y < last; ++y) {
      std::uint8_t* marks = state.marks.row(y);
      if (y < 2 || y >= height - 2) {
        std::memset(marks, 0, static_cast<size_t>(width));
      } else {
        const std::uint8_t* const rows[5] = {state.raw_mask.row(y - 2), state.raw_mask.row(y - 1),
                                             state.raw_mask.row(y), state.raw_mask.row(y + 1),
                                             state.raw_mask.row(y + 2)};
        kernel.lone_black_row(rows, marks, width);
      }
      // Pixels closer than 2 to the border have no 5x5 border of their own.
      marks[0] = marks[1] = marks[width - 2] = marks[width - 1] = 0;
      marks[-1] = marks[width] = 0;
    }
  });
  for (const int y : {-1, height})
    std::memset(state.marks.row(y) - 1, 0, static_cast<size_t>(width + 2));
  for_row_bands(height, [&](int first, int last) {
    for (int y = first; y < last; ++y) {
      const std::uint8_t* const marks[3] = {state.marks.row(y - 1), state.marks.row(y),
                                            state.marks.row(y + 1)};
      kernel.whiten_row(state.raw_mask.row(y), marks, state.mask.row(y), width);
    }
  });
  watch.image("pepper", state.mask.view());
}

void sketch_lines(const cv::Mat& frame, const CartoonOptions& options, State& state,
                  const Watch& watch) {
  smooth_gray(frame, options, state, state.lines, watch);
  line_response(options, state, watch);
  threshold_lines(options.sketch.threshold, options.steady, state.lines, state, watch);
  remove_pepper(options, state, watch);
}

void evil_lines(const cv::Mat& frame, const CartoonOptions& options, State& state,
                const Watch& watch) {
  smooth_gray(frame, options, state, state.evil_lines, watch);
  evil_response(options, state, watch);
  threshold_lines(options.evil.threshold, options.steady, state.evil_lines, state, watch);
  const auto timer = watch.time("mask median");
  const int width = frame.cols;
  state.mask.resize(width, frame.rows);
  cv::Mat mask = state.mask.view();
  if (options.evil.median_size == 1) {
    state.raw_mask.view().copyTo(mask);
  } else if (is_fast(options) && options.evil.median_size == 3) {
    const Kernels& kernel = kernels();
    for (int y = 0; y < frame.rows; ++y) state.raw_mask.extend_row_by_copies(y, 1);
    state.raw_mask.extend_height_by_copies(1);
    for_row_bands(frame.rows, [&](int first, int last) {
      for (int y = first; y < last; ++y) {
        const std::uint8_t* const rows[3] = {state.raw_mask.row(y - 1), state.raw_mask.row(y),
                                             state.raw_mask.row(y + 1)};
        kernel.median3_row(rows, state.mask.row(y), width);
      }
    });
  } else {
    cv::medianBlur(state.raw_mask.view(), mask, options.evil.median_size);
  }
  watch.image("lines", mask);
}

// --- painting ---

// Paints at half size into state.small.
void paint_small(const cv::Mat& frame, const CartoonOptions& options, State& state,
                 const Watch& watch, const std::stop_token& stop) {
  {
    const auto timer = watch.time("half size");
    cv::resize(frame, state.small, cv::Size(frame.cols / 2, frame.rows / 2), 0, 0,
               cv::INTER_LINEAR);
  }
  watch.image("half size", state.small);
  const auto timer = watch.time("bilateral");
  const int rounds = options.quality == Quality::kDraft ? (options.paint.rounds * 3 + 6) / 7
                                                        : options.paint.rounds;
  if (is_fast(options) && kernels().vectorized && BilateralPainter::supports(options.paint)) {
    state.painter.paint(state.small, options.paint, 2 * rounds);
  } else {
    for (int i = 0; i < 2 * rounds; ++i) {
      throw_if_stopped(stop);
      cv::bilateralFilter(state.small, state.small_other, options.paint.diameter,
                          options.paint.sigma_color, options.paint.sigma_space);
      cv::swap(state.small, state.small_other);
    }
  }
  watch.image("painting", state.small);
}

// Enlarges state.small to `large`, with the lines of state.mask in black if `lines`.
void enlarge(const cv::Size& size, bool lines, const CartoonOptions& options, State& state,
             cv::Mat& large, const Watch& watch) {
  const auto timer = watch.time(lines ? "full size and lines" : "full size");
  large.create(size, CV_8UC3);
  if (is_fast(options)) {
    state.enlarger.enlarge(state.small, lines ? &state.mask : nullptr, large);
    return;
  }
  cv::resize(state.small, large, size, 0, 0, cv::INTER_LINEAR);
  if (lines) large.setTo(cv::Scalar::all(0), state.mask.view() == 0);
}

// Enlarges state.small to state.large, only where smooth_skin reads it.
void enlarge_for_skin(const cv::Size& size, const cv::Mat& skin, const CartoonOptions& options,
                      State& state, const Watch& watch) {
  if (!is_fast(options) || size != skin.size() * 2) {
    enlarge(size, false, options, state, state.large, watch);
    return;
  }
  const auto timer = watch.time("full size");
  state.large.create(size, CV_8UC3);
  const cv::Rect area = smoothed_area(skin);
  if (area.empty()) return;
  cv::Mat large = state.large(cv::Rect(area.tl() * 2, area.size() * 2));
  state.enlarger.enlarge(state.small(area), nullptr, large);
}

void show_lines(State& state) { cv::cvtColor(state.mask.view(), state.output, cv::COLOR_GRAY2BGR); }

// --- skin ---

// The skin in state.small; the automatic mode also detects and remembers the faces.
cv::Mat skin_of(const cv::Mat& frame, const CartoonOptions& options, State& state,
                const Watch& watch) {
  const auto timer = watch.time("skin");
  cv::Mat skin;
  if (options.skin.face == FaceMode::kOutline) {
    state.faces.clear();
    skin = find_skin(state.small, state.response.view(), options.skin, state.skin);
  } else {
    if (!state.follower) {
      face::FaceDetectorOptions detector{.max_width = 320};
      if (!options.skin.cascade.empty()) detector.cascade = options.skin.cascade;
      state.follower.emplace(detector);
    }
    state.faces.clear();
    std::vector<cv::Rect> small_faces;
    std::vector<SkinColor> colors;
    std::map<int, SkinColor> known;
    cv::cvtColor(state.small, state.skin.ycrcb, cv::COLOR_BGR2YCrCb);
    for (const face::FaceFollower::Face& face : state.follower->follow(frame)) {
      const cv::Rect small(face.box.x / 2, face.box.y / 2, face.box.width / 2, face.box.height / 2);
      if (small.width < 4 || small.height < 4) continue;
      // Updated while the face is visible. The blending limits the effect of a hand in front of the
      // face.
      constexpr double kLearn = 0.1;
      SkinColor color = learn_skin_color(state.skin.ycrcb, small);
      const auto earlier = state.skin_colors.find(face.id);
      if (earlier != state.skin_colors.end()) {
        const double share = face.missed == 0 ? kLearn : 0;
        color.mean = earlier->second.mean + share * (color.mean - earlier->second.mean);
        color.inverse_covariance =
            earlier->second.inverse_covariance +
            (color.inverse_covariance - earlier->second.inverse_covariance) * share;
      }
      known[face.id] = color;
      state.faces.push_back(face.box);
      small_faces.push_back(small);
      colors.push_back(color);
    }
    state.skin_colors = std::move(known);
    skin = find_skin_of_faces(state.small, small_faces, colors, options.skin, state.skin);
  }
  if (watch.wants_images()) watch.image("skin", skin * 255);
  return skin;
}

}  // namespace

const cv::Mat& cartoonize(const cv::Mat& frame, const CartoonOptions& options, CartoonState& state,
                          DebugSink* debug, Timers* timers, const std::stop_token& stop) {
  require_bgr(frame);
  constexpr int kMinSize = 16;
  TARSIER_REQUIRE(frame.cols >= kMinSize && frame.rows >= kMinSize,
                  "the image is {}x{}, smaller than {}x{}", frame.cols, frame.rows, kMinSize,
                  kMinSize);
  options.check();
  const Watch watch(debug, timers);
  const auto timer = watch.time("total");
  State& my = state.impl();
  if (my.size != frame.size()) {
    state.reset();
    my.size = frame.size();
  }
  watch.image("frame", frame);
  switch (options.mode) {
    case Mode::kNone:
      my.output = frame;
      return my.output;
    case Mode::kSketch:
      sketch_lines(frame, options, my, watch);
      break;
    case Mode::kEvilSketch:
      evil_lines(frame, options, my, watch);
      break;
    case Mode::kCartoon:
      sketch_lines(frame, options, my, watch);
      paint_small(frame, options, my, watch, stop);
      break;
    case Mode::kEvil:
      evil_lines(frame, options, my, watch);
      paint_small(frame, options, my, watch, stop);
      break;
    case Mode::kPaint:
      paint_small(frame, options, my, watch, stop);
      break;
    case Mode::kAlien:
      sketch_lines(frame, options, my, watch);
      paint_small(frame, options, my, watch, stop);
      break;
    case Mode::kSmooth:
      if (options.steady.on || watch.wants_images()) {
        sketch_lines(frame, options, my, watch);  // the stabiliser needs the lines of every frame
      } else {
        smooth_gray(frame, options, my, my.lines, watch);
        line_response(options, my, watch);
      }
      paint_small(frame, options, my, watch, stop);
      break;
  }
  // The last frame may still be shared with the output (mode none): never write into it.
  if (my.output.data == frame.data || (my.output.u != nullptr && my.output.u->refcount > 1)) {
    my.output.release();
  }
  switch (options.mode) {
    case Mode::kSketch:
    case Mode::kEvilSketch:
      show_lines(my);
      break;
    case Mode::kPaint:
      enlarge(frame.size(), false, options, my, my.output, watch);
      break;
    case Mode::kCartoon:
    case Mode::kEvil:
      enlarge(frame.size(), true, options, my, my.output, watch);
      break;
    case Mode::kAlien:
      color_skin(my.small, skin_of(frame, options, my, watch), options.skin);
      watch.image("coloured", my.small);
      enlarge(frame.size(), true, options, my, my.output, watch);
      break;
    case Mode::kSmooth: {
      const cv::Mat skin = skin_of(frame, options, my, watch);
      enlarge_for_skin(frame.size(), skin, options, my, watch);
      const auto blend_timer = watch.time("blend");
      smooth_skin(frame, my.large, skin, my.skin, my.output);
      break;
    }
    case Mode::kNone:
      break;
  }
  watch.image("result", my.output);
  return my.output;
}

}  // namespace tarsier::cartoon
