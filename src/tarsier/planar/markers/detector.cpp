// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/detector.h"

#include <fmt/format.h>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <optional>

namespace tarsier::planar::markers {
namespace {

constexpr double kMaxFalsePositiveProbability = 0.005;
constexpr double kMaxBlurredFalsePositiveProbability =
    0.02;  // the correlation of the whole marker decides

double size_of(const Quad& quad) { return (quad[0] - quad[2]).norm() / std::sqrt(2.0); }

bool is_better(const Marker& a, const Marker& b) {
  if (a.errors != b.errors) return a.errors < b.errors;
  return a.margin > b.margin;
}

// The cells match after `rotation` anticlockwise quarter turns, so the marker's own top left is
// that many corners later.
Quad rotated_quad(const Quad& quad, int rotation) {
  Quad result;
  for (std::size_t k = 0; k < 4; ++k)
    result[k] = quad[(k + static_cast<std::size_t>(rotation)) % 4];
  return result;
}

Marker marker_of(const Match& match, const Quad& quad, const Cells& cells) {
  Marker marker;
  marker.id = match.id;
  marker.corners = rotated_quad(quad, match.rotation);
  marker.errors = match.errors;
  marker.contrast = cells.contrast;
  marker.margin = cells.margin;
  return marker;
}

void apply_alignment(const Alignment& alignment, Marker& marker) {
  marker.corners = alignment.corners;
  marker.correlation = alignment.correlation;
  marker.information.assign(alignment.information.begin(), alignment.information.end());
}

// Maximum number of wrong cells for which random cells are accepted as a marker with a probability
// of at most `max_probability`: markers * turns * sum_k<=e C(n^2, k) / 2^(n^2); at least 0.
int max_tolerable_errors(const Dictionary& dictionary, double max_probability) {
  const int cells = dictionary.cells() * dictionary.cells();
  double ways = 1;  // C(cells, k)
  double sum = 1;
  const double each = 4.0 * dictionary.size() * std::pow(0.5, cells);
  int errors = 0;
  while (errors < cells) {
    ways *= static_cast<double>(cells - errors) / (errors + 1);
    sum += ways;
    if (each * sum > max_probability) break;
    ++errors;
  }
  return errors;
}

// Whether few cells differ from their neighbours, as in bars and corners, which are frequent in
// images. (AprilTags exclude such codes; ArUco's first family begins with them.)
bool is_simple(Code code, int cells) {
  int differ = 0;
  const auto at = [&](int column, int row) {
    return (code >> static_cast<unsigned>(cells * cells - 1 - row * cells - column)) & 1U;
  };
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column + 1 < cells; ++column) {
      differ += at(column, row) != at(column + 1, row) ? 1 : 0;
      differ += at(row, column) != at(row, column + 1) ? 1 : 0;
    }
  }
  return 4 * differ < 2 * cells * (cells - 1);  // a quarter of all pairs
}

// Whether a marker's correlation with the image is high enough.
bool is_plausible(const Marker& marker, const Dictionary& dictionary, double min_correlation) {
  constexpr double kMinSimpleCorrelation = 0.96;
  if (!is_simple(dictionary.code(marker.id), dictionary.cells()))
    return marker.correlation >= min_correlation;
  return marker.errors == 0 && marker.correlation >= kMinSimpleCorrelation;
}

// Evidence of the cells against a marker: sum of the clarity of the wrong cells, divided by the
// total.
double mismatch(const Cells& cells, Code code, int rotation) {
  // The cells were turned anticlockwise to match, so the code is turned clockwise for the
  // comparison.
  for (int turn = 0; turn < rotation; ++turn) code = rotated_clockwise(code, cells.count);
  const auto all = cells.all();
  double sum = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const bool is_white = ((code >> (all.size() - 1 - i)) & 1U) != 0;
    if (is_white != (all[i] > 0)) sum += std::min(1.0F, std::abs(all[i]));
  }
  return sum / static_cast<double>(all.size());
}

// For cells that are too blurred to be read one by one: aligns the markers that agree best with
// their brightness. The one with the highest correlation wins if this is high enough.
std::optional<Marker> read_blurred(const cv::Mat& gray, const Quad& quad, const Cells& cells,
                                   const Dictionary& dictionary, const DetectOptions& options) {
  constexpr int kCandidates = 3;
  constexpr float kSharpening = 1;
  constexpr double kMinCorrelationLead = 0.03;
  constexpr double kMaxMismatch = 0.08;
  std::optional<Marker> best;
  double second = 0;
  const Cells sharp = sharpened(cells, kSharpening);
  const int tolerated_errors =
      max_tolerable_errors(dictionary, kMaxBlurredFalsePositiveProbability);
  for (const Match& match : dictionary.nearest(sharp.all(), kCandidates)) {
    if (match.errors > tolerated_errors) continue;
    if (mismatch(cells, dictionary.code(match.id), match.rotation) > kMaxMismatch) continue;
    Marker marker = marker_of(match, quad, cells);
    const auto aligned = align_marker(gray, dictionary.code(match.id), dictionary.cells(),
                                      marker.corners, options.align);
    if (!aligned) continue;
    apply_alignment(*aligned, marker);
    if (!best || marker.correlation > best->correlation) {
      second = best ? best->correlation : second;
      best = marker;
    } else {
      second = std::max(second, marker.correlation);
    }
  }
  if (!best || best->correlation < second + kMinCorrelationLead ||
      !is_plausible(*best, dictionary, options.decode.min_blurred_correlation))
    return std::nullopt;
  return best;
}

std::optional<Marker> read_marker(const cv::Mat& gray, Quad quad, const Dictionary& dictionary,
                                  const DetectOptions& options) {
  const int n = dictionary.cells();
  RefineOptions refine = options.refine;
  const double cell = size_of(quad) / (n + 2);
  refine.reach_px = std::clamp(0.6 * cell, 1.5, options.refine.reach_px);
  if (!refine_quad(gray, refine, quad)) return std::nullopt;
  const auto cells = read_cells(gray, quad, n, options.decode.min_contrast);
  if (!cells) return std::nullopt;
  const bool is_small = size_of(quad) < options.align_below_px;
  const int max_errors = std::min(
      options.decode.max_errors >= 0 ? options.decode.max_errors : dictionary.correctable() / 2 + 1,
      std::min(dictionary.correctable(),
               max_tolerable_errors(dictionary, kMaxFalsePositiveProbability)));
  const auto match = dictionary.match(cells->read, max_errors, cells->unknown);
  if (!match || cells->frame_errors > options.decode.frame_errors) {
    if (!is_small || cells->frame_errors > 2.5 * options.decode.frame_errors) return std::nullopt;
    return read_blurred(gray, quad, *cells, dictionary, options);
  }
  Marker marker = marker_of(*match, quad, *cells);
  // A large marker without a wrong cell needs no further check.
  if (is_small || match->errors > 0) {
    const auto aligned =
        align_marker(gray, dictionary.code(match->id), n, marker.corners, options.align);
    if (!aligned) return std::nullopt;
    Marker aligned_marker = marker;
    apply_alignment(*aligned, aligned_marker);
    if (!is_plausible(aligned_marker, dictionary, options.decode.min_correlation))
      return std::nullopt;
    if (is_small) return aligned_marker;
  }
  // Refines a second time from the new edges.
  refine.reach_px = std::min(refine.reach_px, 2.0);
  static_cast<void>(refine_quad(gray, refine, marker.corners));
  return marker;
}

void draw_quad(cv::Mat& image, const Quad& quad, const cv::Scalar& color) {
  constexpr int kShift = 4;  // fractional bits
  std::vector<cv::Point> corners;
  for (const Eigen::Vector2d& corner : quad)
    corners.emplace_back(cvRound(corner.x() * (1 << kShift)), cvRound(corner.y() * (1 << kShift)));
  cv::polylines(image, corners, true, color, 1, cv::LINE_AA, kShift);
}

void show_stages(DebugSink& debug, const cv::Mat& gray, const std::vector<Quad>& quads,
                 const std::vector<Marker>& markers, int cells) {
  constexpr int kCell = 16;  // px
  cv::Mat image;
  cv::cvtColor(gray, image, cv::COLOR_GRAY2BGR);
  for (const Quad& quad : quads) draw_quad(image, quad, {0, 140, 255});
  for (const Marker& marker : markers) draw_quad(image, marker.corners, {60, 220, 60});
  debug.image("quadrilaterals", image);
  for (const Marker& marker : markers) {
    // Pixel centres are at integers: pixel p shows the point (p + 0.5) / kCell of the cells.
    const Eigen::Matrix3d cells_from_pixels{
        {1.0 / kCell, 0, 0.5 / kCell}, {0, 1.0 / kCell, 0.5 / kCell}, {0, 0, 1}};
    cv::Mat map;
    cv::eigen2cv(Eigen::Matrix3d(image_from_cells(marker.corners, cells) * cells_from_pixels), map);
    cv::Mat square;
    cv::warpPerspective(gray, square, map, {kCell * (cells + 2), kCell * (cells + 2)},
                        cv::INTER_LINEAR | cv::WARP_INVERSE_MAP);
    debug.image(fmt::format("marker {}", marker.id), square);
  }
}

}  // namespace

void DetectOptions::check() const {
  check_fields(*this);
  quads.check();
  refine.check();
  decode.check();
  align.check();
}

std::vector<Marker> detect_markers(const cv::Mat& gray, const Dictionary& dictionary,
                                   const DetectOptions& options, DetectWorkspace& workspace,
                                   DebugSink* debug) {
  options.check();
  std::vector<Marker> markers;
  const std::vector<Quad> quads = find_quads(gray, options.quads, workspace.quads, debug);
  for (const Quad& quad : quads) {
    auto marker = read_marker(gray, quad, dictionary, options);
    if (!marker) continue;
    const auto same = std::find_if(markers.begin(), markers.end(), [&](const Marker& other) {
      return (center_of(other.corners) - center_of(marker->corners)).norm() <
             0.5 * std::min(size_of(other.corners), size_of(marker->corners));
    });
    if (same == markers.end())
      markers.push_back(*marker);
    else if (is_better(*marker, *same))
      *same = *marker;
  }
  std::stable_sort(markers.begin(), markers.end(),
                   [](const Marker& a, const Marker& b) { return a.id < b.id; });
  if (debug != nullptr) show_stages(*debug, gray, quads, markers, dictionary.cells());
  return markers;
}

}  // namespace tarsier::planar::markers
