// SPDX-License-Identifier: MIT
#include "tarsier/synth/relief.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/synth/noise.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace tarsier::synth {
namespace {

constexpr double kDistance = 10;  // of the cameras from what they look at
constexpr double kFar = 100;      // nothing is drawn beyond
constexpr double kRadians = std::numbers::pi / 180;
constexpr double kStepDeg = 7;
constexpr double kSpanDeg = 60;
constexpr double kRingDeg = 42;  // above the ground
constexpr double kLineStep = 0.9;
constexpr double kLineSpan = 12;

const cv::Vec3d kMiddle{0, 0, 0.8};  // what arc and ring look at
const cv::Vec3d kSun{-0.46, 0.55, 0.697};
constexpr double kAmbient = 0.45;
constexpr double kDirect = 0.75;
const cv::Vec3f kSky{214, 198, 180};
const cv::Vec3f kBare{150, 150, 150};

constexpr double kWallWidth = 51.2;  // units until the wall's texture comes again: beyond the view
constexpr double kWallHeight = 25.6;
constexpr double kFaceCell = 3.2;  // units of the boxes' texture for each face, 8 x 8 of them
constexpr int kFaceCells = 8;
constexpr double kTile = 1.6;  // units, of Content::kRepeated
constexpr double kMaxTexels = 120;
constexpr int kBoxes = 12;
constexpr double kReliefDepth = 2;

enum Stream : std::uint64_t {
  kWallStream = 1,
  kFaceStream,
  kHeightStream,
  kBoxStream,
  kPoseStream
};

// floor() without a call; for |x| < 2^22.
int floor_of(double x) {
  constexpr int kShift = 1 << 22;
  return static_cast<int>(x + kShift) - kShift;
}

int wrapped(int i, int n) {
  if (i >= 0 && i < n) return i;
  i %= n;
  return i < 0 ? i + n : i;
}

// ---- Texture ------------------------------------------------------------------------------------

// Adds one octave of value noise: random values `cell` texels apart with smooth ramps between them.
// `grid` has a row and a column more than cells begin in the plane.
void add_octave(cv::Mat1f& plane, const cv::Mat1f& grid, double cell, float amplitude) {
  std::vector<int> index(static_cast<std::size_t>(plane.cols));
  std::vector<float> weight(index.size());
  const auto place = [cell](int at, int last) {
    const double x = (at + 0.5) / cell;
    const int i = std::min(static_cast<int>(x), last);
    const double f = std::min(x - i, 1.0);
    return std::pair{i, static_cast<float>(f * f * (3 - 2 * f))};
  };
  for (int x = 0; x < plane.cols; ++x) {
    const auto column = static_cast<std::size_t>(x);
    std::tie(index[column], weight[column]) = place(x, grid.cols - 2);
  }
  cv::parallel_for_(cv::Range(0, plane.rows), [&](const cv::Range& rows) {
    std::vector<float> line(static_cast<std::size_t>(grid.cols));
    for (int y = rows.start; y < rows.end; ++y) {
      const auto [row, down] = place(y, grid.rows - 2);
      const float* above = grid[row];
      const float* below = grid[row + 1];
      for (int i = 0; i < grid.cols; ++i) {
        line[static_cast<std::size_t>(i)] = amplitude * (above[i] + down * (below[i] - above[i]));
      }
      float* out = plane[y];
      for (int x = 0; x < plane.cols; ++x) {
        const auto column = static_cast<std::size_t>(x);
        const float* left = line.data() + index[column];
        out[x] += left[0] + weight[column] * (left[1] - left[0]);
      }
    }
  });
}

// Random values for cells of `cell` units. As many for each resolution, so that the scene is the
// same at every size of the pictures.
cv::Mat1f random_grid(double width, double height, double cell, Rng rng) {
  cv::Mat1f grid(static_cast<int>(std::ceil(height / cell - 1e-9)) + 1,
                 static_cast<int>(std::ceil(width / cell - 1e-9)) + 1);
  for (float& value : grid) value = static_cast<float>(rng.uniform(-1, 1));
  return grid;
}

cv::Scalar random_colour(Rng& rng) {
  // Dark or light, seldom between: shapes shall stand out.
  const double level = rng.uniform() < 0.5 ? rng.uniform(8, 90) : rng.uniform(165, 248);
  cv::Scalar colour;
  for (int c = 0; c < 3; ++c) colour[c] = std::clamp(level + rng.uniform(-45, 45), 0.0, 255.0);
  return colour;
}

// One small shape at a random place of a picture with `scale` texels for each unit.
void draw_shape(cv::Mat& image, double width, double height, double scale, Rng& rng) {
  constexpr int kBits = 4;  // of the fractions of texels in OpenCV's drawing
  const auto fixed = [&](double x, double y) {
    return cv::Point(static_cast<int>(std::lround((x * scale - 0.5) * (1 << kBits))),
                     static_cast<int>(std::lround((y * scale - 0.5) * (1 << kBits))));
  };
  const double x = rng.uniform(0, width);
  const double y = rng.uniform(0, height);
  const double radius = 0.035 * std::exp(rng.uniform() * std::log(14.0));  // to 0.49 units
  const double turn = rng.uniform(0, 2 * std::numbers::pi);
  const double slim = rng.uniform(0.35, 1);
  const int kind = rng.integer(0, 4);
  const cv::Scalar colour = random_colour(rng);
  const cv::Scalar second = random_colour(rng);
  const auto blob = [&](double size, const cv::Scalar& fill) {
    cv::circle(image, fixed(x, y), static_cast<int>(std::lround(size * scale * (1 << kBits))), fill,
               cv::FILLED, cv::LINE_AA, kBits);
  };
  const auto polygon = [&](int corners, double size, const cv::Scalar& fill) {
    std::vector<cv::Point> points;
    for (int k = 0; k < corners; ++k) {
      const double a = 2 * std::numbers::pi * (k + 0.5) / corners;
      const double u = size * std::cos(a);
      const double v = size * slim * std::sin(a);
      points.push_back(fixed(x + u * std::cos(turn) - v * std::sin(turn),
                             y + u * std::sin(turn) + v * std::cos(turn)));
    }
    cv::fillConvexPoly(image, points, fill, cv::LINE_AA, kBits);
  };
  if (kind == 0) {
    blob(radius, colour);
  } else if (kind == 1) {
    blob(radius, colour);
    blob(radius * slim * 0.8, second);
  } else {
    polygon(kind + 1, radius * 1.2, colour);
    if (radius > 0.15) polygon(kind + 1, radius * 0.55, second);
  }
}

// A colour texture in units of the world with ever coarser copies, that comes again at its ends.
class Texture {
 public:
  Texture() = default;
  Texture(double width, double height, double texels_per_unit, const Rng& base)
      : scale_(std::max(1.0, std::round(width * texels_per_unit / 16)) * 16 / width) {
    const cv::Size size(static_cast<int>(std::lround(width * scale_)),
                        static_cast<int>(std::lround(height * scale_)));
    cv::Mat1f grey(size, 0.0F);
    std::array<cv::Mat1f, 2> tint{cv::Mat1f(size, 0.0F), cv::Mat1f(size, 0.0F)};
    std::uint64_t stream = 0;
    for (double cell = 3.2; cell > 0.02; cell /= 2) {
      ++stream;
      if (cell > 2 * width || cell * scale_ < 2) continue;
      add_octave(grey, random_grid(width, height, cell, base.fork(stream)), cell * scale_,
                 static_cast<float>(0.62 * std::pow(cell, 0.22)));
      if (cell > 1.7 || cell < 0.15) continue;
      for (std::uint64_t k = 0; k < 2; ++k) {
        add_octave(tint[k], random_grid(width, height, cell, base.fork(100 * (k + 1) + stream)),
                   cell * scale_, 0.16F);
      }
    }
    cv::Mat image(size, CV_8UC3);
    cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& rows) {
      for (int y = rows.start; y < rows.end; ++y) {
        auto* out = image.ptr<cv::Vec3b>(y);
        for (int x = 0; x < size.width; ++x) {
          const float g = grey(y, x) * 1.5F;
          const float level = 128 + 112 * g / std::sqrt(1 + g * g);
          const float warm = 128 * tint[0](y, x);
          const float green = 80 * tint[1](y, x);
          out[x] = {cv::saturate_cast<std::uint8_t>(level - warm),
                    cv::saturate_cast<std::uint8_t>(level + green),
                    cv::saturate_cast<std::uint8_t>(level + warm)};
        }
      }
    });
    Rng rng = base.fork(999);
    const int shapes = static_cast<int>(std::lround(5 * width * height));
    for (int i = 0; i < shapes; ++i) draw_shape(image, width, height, scale_, rng);
    cv::GaussianBlur(image, image, {3, 3}, 0.6);
    levels_.push_back(image);
    while (levels_.size() < 6 && levels_.back().cols % 2 == 0 && levels_.back().rows % 2 == 0) {
      cv::Mat half;
      cv::resize(levels_.back(), half, {}, 0.5, 0.5, cv::INTER_AREA);
      levels_.push_back(half);
    }
  }

  // At (u, v) units, of details larger than `footprint` units.
  [[nodiscard]] cv::Vec3f at(double u, double v, double footprint) const {
    const auto top = static_cast<double>(levels_.size() - 1);
    const double level = std::clamp(std::log2(footprint * scale_), 0.0, top);
    const auto whole = static_cast<std::size_t>(level);
    const auto part = static_cast<float>(level - static_cast<double>(whole));
    const cv::Vec3f fine = bilinear(levels_[whole], u, v, whole);
    if (part == 0) return fine;
    return fine + part * (bilinear(levels_[whole + 1], u, v, whole + 1) - fine);
  }

 private:
  [[nodiscard]] cv::Vec3f bilinear(const cv::Mat& level, double u, double v,
                                   std::size_t halvings) const {
    const double scale = scale_ / static_cast<double>(1U << halvings);
    const double x = u * scale - 0.5;
    const double y = v * scale - 0.5;
    const int xi = floor_of(x);
    const int yi = floor_of(y);
    const auto fx = static_cast<float>(x - xi);
    const auto fy = static_cast<float>(y - yi);
    const int x0 = wrapped(xi, level.cols);
    const int x1 = wrapped(xi + 1, level.cols);
    const auto* above = level.ptr<cv::Vec3b>(wrapped(yi, level.rows));
    const auto* below = level.ptr<cv::Vec3b>(wrapped(yi + 1, level.rows));
    cv::Vec3f out;
    for (int c = 0; c < 3; ++c) {
      const auto a = static_cast<float>(above[x0][c]);
      const auto b = static_cast<float>(above[x1][c]);
      const auto d = static_cast<float>(below[x0][c]);
      const auto e = static_cast<float>(below[x1][c]);
      const float up = a + fx * (b - a);
      out[c] = up + fy * (d + fx * (e - d) - up);
    }
    return out;
  }

  double scale_ = 1;  // texels per unit
  std::vector<cv::Mat> levels_;
};

// ---- Shape --------------------------------------------------------------------------------------

// z over (x, y): a quadratic B-spline, so that height and slope are exact and smooth.
class HeightField {
 public:
  HeightField() = default;  // flat

  explicit HeightField(const Rng& base) : values_(kRows, kCols, 0.0) {
    std::uint64_t stream = 0;
    double amplitude = 1;
    for (const int step : {32, 16, 8, 4}) {  // control points in a cell: 6.4 to 0.8 units
      Rng rng = base.fork(++stream);
      cv::Mat1d grid(kRows / step, kCols / step);
      for (double& value : grid) value = rng.uniform(-1, 1);
      for (int y = 0; y < kRows; ++y) {
        for (int x = 0; x < kCols; ++x) {
          const auto ramp = [step](int at) {
            const double f = static_cast<double>(at % step) / step;
            return f * f * (3 - 2 * f);
          };
          const auto value = [&](int dy, int dx) {
            return grid((y / step + dy) % grid.rows, (x / step + dx) % grid.cols);
          };
          const double up = value(0, 0) + ramp(x) * (value(0, 1) - value(0, 0));
          const double low = value(1, 0) + ramp(x) * (value(1, 1) - value(1, 0));
          values_(y, x) += amplitude * (up + ramp(y) * (low - up));
        }
      }
      amplitude *= 0.5;
    }
    double low = 0;
    double high = 0;
    cv::minMaxLoc(values_, &low, &high);
    for (double& value : values_) value = kReliefDepth * (value - low) / (high - low);
    top_ = kReliefDepth;
    // The slope of the spline along an axis is a mean of those of its control points.
    double slope_x = 0;
    double slope_y = 0;
    for (int y = 0; y < kRows; ++y) {
      for (int x = 0; x < kCols; ++x) {
        const double here = values_(y, x);
        slope_x = std::max(slope_x, std::abs(values_(y, (x + 1) % kCols) - here));
        slope_y = std::max(slope_y, std::abs(values_((y + 1) % kRows, x) - here));
      }
    }
    steepest_ = std::hypot(slope_x, slope_y) / kSpacing;
  }

  [[nodiscard]] bool is_flat() const { return values_.empty(); }

  [[nodiscard]] double height(double x, double y) const {
    if (is_flat()) return 0;
    const Weights u(x);
    const Weights v(y);
    double sum = 0;
    for (int j = 0; j < 3; ++j) {
      const double* row = values_[(v.first + j) & (kRows - 1)];
      double line = 0;
      for (int i = 0; i < 3; ++i) line += u.value[i] * row[(u.first + i) & (kCols - 1)];
      sum += v.value[j] * line;
    }
    return sum;
  }

  [[nodiscard]] cv::Vec2d slope(double x, double y) const {
    if (is_flat()) return {0, 0};
    const Weights u(x);
    const Weights v(y);
    cv::Vec2d sum{0, 0};
    for (int j = 0; j < 3; ++j) {
      const double* row = values_[(v.first + j) & (kRows - 1)];
      for (int i = 0; i < 3; ++i) {
        const double value = row[(u.first + i) & (kCols - 1)];
        sum[0] += u.slope(i) * v.value[j] * value;
        sum[1] += u.value[i] * v.slope(j) * value;
      }
    }
    return sum / kSpacing;
  }

  // The first t < limit where origin + t * direction meets the surface from above; `limit` if none.
  [[nodiscard]] double first_hit(const cv::Vec3d& origin, const cv::Vec3d& direction,
                                 double limit) const {
    if (direction[2] >= 0) return limit;
    double t = (top_ - origin[2]) / direction[2];
    if (is_flat()) return std::min(t, limit);
    // No surface of this slope can be met earlier than after this share of the gap.
    const double pace = 1 / (-direction[2] + steepest_ * std::hypot(direction[0], direction[1]));
    const auto gap_at = [&](double at) {
      return origin[2] + at * direction[2] -
             height(origin[0] + at * direction[0], origin[1] + at * direction[1]);
    };
    constexpr double kNear = 0.02;
    constexpr double kExact = 1e-9;
    double gap = gap_at(t);
    for (int i = 0; i < 2000 && gap > kExact; ++i) {
      if (t >= limit) return limit;
      if (gap < kNear) {
        const double exact = refined(origin, direction, t, gap);
        if (exact >= 0) return std::min(exact, limit);
      }
      t += gap * pace;
      gap = gap_at(t);
    }
    return std::min(t, limit);
  }

 private:
  static constexpr int kCols = 256;  // powers of 2
  static constexpr int kRows = 128;
  static constexpr double kSpacing = 0.2;

  struct Weights {
    explicit Weights(double x) {
      const double u = x / kSpacing;
      const int nearest = floor_of(u + 0.5);
      f = u - nearest;
      first = nearest - 1;
      value[0] = 0.5 * (0.5 - f) * (0.5 - f);
      value[1] = 0.75 - f * f;
      value[2] = 0.5 * (0.5 + f) * (0.5 + f);
    }
    [[nodiscard]] double slope(int i) const {
      return i == 0 ? f - 0.5 : (i == 1 ? -2 * f : f + 0.5);
    }
    double f = 0;
    int first = 0;
    double value[3] = {};
  };

  // Newton's steps from close above the surface; negative if they lead away, as they do where the
  // ray only just passes.
  [[nodiscard]] double refined(const cv::Vec3d& origin, const cv::Vec3d& direction, double start,
                               double gap) const {
    double t = start;
    for (int i = 0; i < 6; ++i) {
      const double x = origin[0] + t * direction[0];
      const double y = origin[1] + t * direction[1];
      const cv::Vec2d s = slope(x, y);
      const double closing = s[0] * direction[0] + s[1] * direction[1] - direction[2];
      if (closing < 0.15) return -1;
      t += gap / closing;
      if (t < start || t > start + 0.15) return -1;
      gap = origin[2] + t * direction[2] -
            height(origin[0] + t * direction[0], origin[1] + t * direction[1]);
      if (std::abs(gap) < 1e-9) return t;
    }
    return -1;
  }

  cv::Mat1d values_;  // control points; empty: flat
  double top_ = 0;
  double steepest_ = 0;
};

// Stands on z = 0, turned about z.
struct Box {
  double x = 0;
  double y = 0;
  double half[2] = {};
  double top = 0;
  double cosine = 1;
  double sine = 0;
  cv::Vec3f tint;

  [[nodiscard]] cv::Vec3d to_own(const cv::Vec3d& v) const {
    return {cosine * v[0] + sine * v[1], -sine * v[0] + cosine * v[1], v[2]};
  }
  [[nodiscard]] cv::Vec3d from_own(const cv::Vec3d& v) const {
    return {cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1], v[2]};
  }
};

struct Hit {
  double t = kFar;
  int box = -1;  // -1: the wall
  int face = 0;  // 0..3: -x, +x, -y, +y, 4: top
  bool is_any = false;
};

// Moves `hit` to the box if it is met earlier. Origin and direction are in the box's own axes.
void meet_box(const Box& box, int number, const cv::Vec3d& origin, const cv::Vec3d& direction,
              Hit& hit) {
  const double low[3] = {-box.half[0], -box.half[1], 0};
  const double high[3] = {box.half[0], box.half[1], box.top};
  double enter = 0;
  double leave = hit.t;
  int face = -1;
  for (int axis = 0; axis < 3; ++axis) {
    const double inverse = 1 / direction[axis];  // infinite when parallel: the comparisons hold
    double first = (low[axis] - origin[axis]) * inverse;
    double last = (high[axis] - origin[axis]) * inverse;
    int side = 2 * axis;
    if (first > last) {
      std::swap(first, last);
      side = axis == 2 ? 4 : side + 1;
    }
    if (first > enter) {
      enter = first;
      face = side;
    }
    leave = std::min(leave, last);
    if (!(enter < leave)) return;
  }
  if (face >= 0) hit = {enter, number, face, true};
}

// ---- Cameras ------------------------------------------------------------------------------------

geometry::Camera make_camera(const cv::Size& size, double focal) {
  geometry::Camera camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = focal;
  camera.cx = (size.width - 1) / 2.0;
  camera.cy = (size.height - 1) / 2.0;
  return camera;
}

// A camera at `center`, `up` above in its picture but for `roll` degrees.
geometry::Rigid look_along(const cv::Vec3d& center, const cv::Vec3d& direction, const cv::Vec3d& up,
                           double roll) {
  const cv::Vec3d forward = cv::normalize(direction);
  const cv::Vec3d level = cv::normalize(forward.cross(up));
  const cv::Vec3d plumb = forward.cross(level);
  const cv::Vec3d right = std::cos(roll * kRadians) * level + std::sin(roll * kRadians) * plumb;
  const cv::Vec3d down = forward.cross(right);
  geometry::Rigid pose;
  for (int c = 0; c < 3; ++c) {
    pose.rotation(0, c) = right[c];
    pose.rotation(1, c) = down[c];
    pose.rotation(2, c) = forward[c];
  }
  pose.translation = -(pose.rotation * center);
  return pose;
}

// Steps of `step` with all of them no longer than `span`, even about 0.
double spread(int index, int count, double step, double span) {
  const double stride = count > 1 ? std::min(step, span / (count - 1)) : step;
  return (index - (count - 1) / 2.0) * stride;
}

// Held by hand: each camera is a little off its place and aim.
geometry::Rigid make_pose(Trajectory trajectory, bool pure_rotation, int index, int count,
                          const Rng& base) {
  Rng rng = base.fork(static_cast<std::uint64_t>(index));
  const cv::Vec3d y_up{0, 1, 0};
  const cv::Vec3d shake{rng.uniform(-0.08, 0.08), rng.uniform(-0.35, 0.35),
                        rng.uniform(-0.15, 0.15)};
  const cv::Vec3d aim{rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 0};
  const double roll = rng.uniform(-2, 2);
  if (pure_rotation) {
    const double yaw = spread(index, count, kStepDeg, kSpanDeg) * kRadians;
    const double pitch = rng.uniform(-5, 5) * kRadians;
    return look_along(
        {0, 0, kDistance},
        {std::sin(yaw) * std::cos(pitch), std::sin(pitch), -std::cos(yaw) * std::cos(pitch)}, y_up,
        roll);
  }
  switch (trajectory) {
    case Trajectory::kArc: {
      const double angle = spread(index, count, kStepDeg, kSpanDeg) * kRadians;
      const cv::Vec3d center =
          kMiddle + kDistance * cv::Vec3d(std::sin(angle), 0, std::cos(angle)) + shake;
      return look_along(center, kMiddle + aim - center, y_up, roll);
    }
    case Trajectory::kRing: {
      const double angle = 360.0 * index / count * kRadians;
      const double rise = (kRingDeg + rng.uniform(-2, 2)) * kRadians;
      const cv::Vec3d center =
          kMiddle + kDistance * cv::Vec3d(std::cos(rise) * std::cos(angle),
                                          std::cos(rise) * std::sin(angle), std::sin(rise));
      return look_along(center, kMiddle + aim - center, {0, 0, 1}, roll);
    }
    case Trajectory::kLine:
      break;
  }
  const cv::Vec3d center{spread(index, count, kLineStep, kLineSpan), 0, kDistance};
  return look_along(center + shake, cv::Vec3d(0, 0, -kDistance) + aim, y_up, roll);
}

}  // namespace

void SceneOptions::check() const {
  TARSIER_REQUIRE(
      size.width >= 32 && size.width <= 8192 && size.height >= 32 && size.height <= 8192,
      "size {}x{}", size.width, size.height);
  const int side = std::max(size.width, size.height);
  TARSIER_REQUIRE(focal_px == 0 || (focal_px >= 0.5 * side && focal_px <= 20.0 * side),
                  "focal length {} px of a picture of {} px", focal_px, side);
  TARSIER_REQUIRE(images >= 1 && images <= 1000, "{} images", images);
  TARSIER_REQUIRE(noise >= 0 && noise <= 64, "noise {}", noise);
  TARSIER_REQUIRE(trajectory >= Trajectory::kArc && trajectory <= Trajectory::kLine,
                  "trajectory {}", static_cast<int>(trajectory));
  TARSIER_REQUIRE(content >= Content::kRelief && content <= Content::kNothing, "content {}",
                  static_cast<int>(content));
}

struct ReliefScene::Parts {
  SceneOptions options;
  geometry::Camera camera;
  std::vector<geometry::Rigid> poses;
  HeightField field;
  std::vector<Box> boxes;
  Texture wall;   // not for kNothing
  Texture faces;  // for boxes

  explicit Parts(const SceneOptions& wanted) : options(wanted) {
    const int side = std::max(options.size.width, options.size.height);
    const double focal = options.focal_px > 0 ? options.focal_px : side;
    camera = make_camera(options.size, focal);
    const Rng base(options.seed);
    for (int i = 0; i < options.images; ++i) {
      poses.push_back(make_pose(options.trajectory, options.pure_rotation, i, options.images,
                                base.fork(kPoseStream)));
    }
    const Content content = options.content;
    // A little finer than the pixels of a camera at its usual distance.
    const double texels = std::clamp(1.25 * focal / kDistance, 10.0, kMaxTexels);
    if (content == Content::kRelief || content == Content::kRepeated) {
      field = HeightField(base.fork(kHeightStream));
    }
    if (content == Content::kRepeated) {
      wall = Texture(kTile, kTile, texels, base.fork(kWallStream));
    } else if (content != Content::kNothing) {
      wall = Texture(kWallWidth, kWallHeight, texels, base.fork(kWallStream));
    }
    if (content == Content::kRelief || content == Content::kBoxes) {
      place_boxes(base.fork(kBoxStream));
      faces =
          Texture(kFaceCell * kFaceCells, kFaceCell * kFaceCells, texels, base.fork(kFaceStream));
    }
  }

  // One in each field of a 4 x 3 board, so that they spread and hardly touch.
  void place_boxes(Rng rng) {
    const bool on_plane = options.content == Content::kBoxes;
    const double pitch_x = on_plane ? 2.1 : 2.7;
    const double pitch_y = on_plane ? 2.1 : 2.5;
    for (int i = 0; i < kBoxes; ++i) {
      Box box;
      box.x = (i % 4 - 1.5 + rng.uniform(-0.2, 0.2)) * pitch_x;
      box.y = (i / 4 - 1.0 + rng.uniform(-0.2, 0.2)) * pitch_y;
      for (double& half : box.half) half = rng.uniform(0.35, 0.8);
      // Smaller than a cell of the faces' texture.
      box.top = on_plane ? rng.uniform(0.6, 2.6) : field.height(box.x, box.y) + rng.uniform(0.4, 1);
      const double turn = rng.uniform(-45, 45) * kRadians;
      box.cosine = std::cos(turn);
      box.sine = std::sin(turn);
      for (int c = 0; c < 3; ++c) box.tint[c] = static_cast<float>(rng.uniform(0.72, 1.08));
      boxes.push_back(box);
    }
  }

  [[nodiscard]] const geometry::Rigid& pose_of(int index) const {
    TARSIER_REQUIRE(index >= 0 && index < options.images, "image {} of {}", index, options.images);
    return poses[static_cast<std::size_t>(index)];
  }

  // What one camera needs for its rays.
  struct View {
    cv::Matx33d to_world;
    cv::Vec3d center;
    std::vector<cv::Vec3d> in_box;   // the centre, in each box's own axes
    std::vector<cv::Rect2d> around;  // each box in the picture, px
  };

  [[nodiscard]] View view_of(const geometry::Rigid& pose) const {
    View view{pose.rotation.t(), pose.center(), {}, {}};
    for (const Box& box : boxes) {
      view.in_box.push_back(box.to_own(view.center - cv::Vec3d(box.x, box.y, 0)));
      double left = 1e9;
      double right = -1e9;
      double upper = 1e9;
      double lower = -1e9;
      for (unsigned k = 0; k < 8; ++k) {
        const cv::Vec3d corner{(k & 1U) != 0 ? box.half[0] : -box.half[0],
                               (k & 2U) != 0 ? box.half[1] : -box.half[1],
                               (k & 4U) != 0 ? box.top : 0};
        const cv::Vec3d at = pose * (box.from_own(corner) + cv::Vec3d(box.x, box.y, 0));
        if (at[2] < 0.1) {  // beside or behind the camera: look everywhere
          left = upper = -1e9;
          right = lower = 1e9;
          break;
        }
        const double u = camera.fx * at[0] / at[2] + camera.cx;
        const double v = camera.fy * at[1] / at[2] + camera.cy;
        left = std::min(left, u - 1);
        right = std::max(right, u + 1);
        upper = std::min(upper, v - 1);
        lower = std::max(lower, v + 1);
      }
      view.around.emplace_back(left, upper, right - left, lower - upper);
    }
    return view;
  }

  // Of length 1 along the camera's axis, so that t of a hit is its depth.
  [[nodiscard]] cv::Vec3d ray(const View& view, double u, double v) const {
    return view.to_world * cv::Vec3d((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1);
  }

  [[nodiscard]] Hit trace(const View& view, const cv::Vec3d& direction, double u, double v) const {
    Hit hit;
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      if (!view.around[i].contains(cv::Point2d(u, v))) continue;
      meet_box(boxes[i], static_cast<int>(i), view.in_box[i], boxes[i].to_own(direction), hit);
    }
    const double t = field.first_hit(view.center, direction, hit.t);
    if (t < hit.t) hit = {t, -1, 0, true};
    return hit;
  }

  [[nodiscard]] cv::Vec3f colour(const View& view, const cv::Vec3d& direction,
                                 const Hit& hit) const {
    if (!hit.is_any) return kSky;
    // Two samples in a pixel's width.
    const double reach = std::sqrt(direction.dot(direction));
    const auto footprint = [&](const cv::Vec3d& normal) {
      const double cosine = std::max(0.05, -normal.dot(direction) / reach);
      return 0.5 * hit.t / camera.fx / std::sqrt(cosine);
    };
    const auto light = [](const cv::Vec3d& normal) {
      return static_cast<float>(kAmbient + kDirect * std::max(0.0, normal.dot(kSun)));
    };
    if (hit.box < 0) {
      const cv::Vec3d at = view.center + hit.t * direction;
      const cv::Vec2d slope = field.slope(at[0], at[1]);
      const cv::Vec3d normal = cv::normalize(cv::Vec3d(-slope[0], -slope[1], 1));
      if (options.content == Content::kNothing) return light(normal) * kBare;
      return light(normal) *
             wall.at(at[0] + kWallWidth / 2, at[1] + kWallHeight / 2, footprint(normal));
    }
    const auto number = static_cast<std::size_t>(hit.box);
    const Box& box = boxes[number];
    const cv::Vec3d at = view.in_box[number] + hit.t * box.to_own(direction);
    cv::Vec3d own{0, 0, 0};
    own[hit.face / 2] = hit.face == 4 || hit.face % 2 == 1 ? 1 : -1;
    const cv::Vec3d normal = box.from_own(own);
    const int cell = hit.box * 5 + hit.face;
    const double u = (hit.face < 2 ? at[1] : at[0]) + kFaceCell * (cell % kFaceCells + 0.5);
    const double v =
        (hit.face == 4 ? at[1] : at[2] - box.top / 2) + kFaceCell * (cell / kFaceCells + 0.5);
    return light(normal) * faces.at(u, v, footprint(normal)).mul(box.tint);
  }
};

ReliefScene::ReliefScene(const SceneOptions& options) {
  options.check();
  parts_ = std::make_shared<const Parts>(options);
}

int ReliefScene::count() const { return parts_->options.images; }

geometry::Camera ReliefScene::camera() const { return parts_->camera; }

geometry::Rigid ReliefScene::pose(int index) const { return parts_->pose_of(index); }

cv::Mat ReliefScene::render(int index, const std::stop_token& stop) const {
  const Parts& parts = *parts_;
  const Parts::View view = parts.view_of(parts.pose_of(index));
  cv::Mat image(parts.options.size, CV_8UC3);
  cv::parallel_for_(cv::Range(0, image.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end && !stop.stop_requested(); ++y) {
      auto* out = image.ptr<cv::Vec3b>(y);
      for (int x = 0; x < image.cols; ++x) {
        cv::Vec3f sum{0, 0, 0};
        for (int k = 0; k < 4; ++k) {
          const double u = x + (k % 2 == 0 ? -0.25 : 0.25);
          const double v = y + (k / 2 == 0 ? -0.25 : 0.25);
          const cv::Vec3d direction = parts.ray(view, u, v);
          sum += parts.colour(view, direction, parts.trace(view, direction, u, v));
        }
        for (int c = 0; c < 3; ++c) out[x][c] = cv::saturate_cast<std::uint8_t>(sum[c] / 4);
      }
    }
  });
  throw_if_stopped(stop);
  add_noise(image, parts.options.noise,
            Rng(parts.options.seed).fork(1000 + static_cast<std::uint64_t>(index))());
  return image;
}

std::optional<double> ReliefScene::depth(int index, cv::Point2d pixel) const {
  const Parts& parts = *parts_;
  const Parts::View view = parts.view_of(parts.pose_of(index));
  const Hit hit = parts.trace(view, parts.ray(view, pixel.x, pixel.y), pixel.x, pixel.y);
  if (!hit.is_any) return std::nullopt;
  return hit.t;
}

PointProblem make_point_problem(std::uint64_t seed, int images, int points, double noise_px,
                                double outlier_share) {
  TARSIER_REQUIRE(images >= 1 && images <= 1000, "{} images", images);
  TARSIER_REQUIRE(points >= 1 && points <= 1000000, "{} points", points);
  TARSIER_REQUIRE(noise_px >= 0 && noise_px <= 100, "noise {} px", noise_px);
  TARSIER_REQUIRE(outlier_share >= 0 && outlier_share <= 1, "share {}", outlier_share);
  PointProblem problem;
  const cv::Size size(640, 480);
  problem.camera = make_camera(size, size.width);
  const geometry::Camera& camera = problem.camera;
  const Rng base(seed);
  Rng places = base.fork(1);
  for (int i = 0; i < points; ++i) {
    const double x = places.uniform(-3, 3);
    const double y = places.uniform(-2, 2);
    problem.points.push_back(kMiddle + cv::Vec3d(x, y, places.uniform(-1.5, 1.5)));
  }
  const cv::Rect2d picture(-0.5, -0.5, size.width, size.height);
  for (int i = 0; i < images; ++i) {
    problem.poses.push_back(make_pose(Trajectory::kArc, false, i, images, base.fork(2)));
    Rng rng = base.fork(100 + static_cast<std::uint64_t>(i));
    for (int k = 0; k < points; ++k) {
      const cv::Vec3d at = problem.poses.back() * problem.points[static_cast<std::size_t>(k)];
      if (at[2] <= 0) continue;
      const cv::Point2d exact(camera.fx * at[0] / at[2] + camera.cx,
                              camera.fy * at[1] / at[2] + camera.cy);
      if (!picture.contains(exact)) continue;
      PointProblem::Seen seen{i, k, exact, rng.uniform() < outlier_share};
      if (seen.outlier) {
        do {
          seen.pixel.x = rng.uniform(0, size.width - 1);
          seen.pixel.y = rng.uniform(0, size.height - 1);
        } while (cv::norm(seen.pixel - exact) <= 10);
      } else {
        seen.pixel.x += rng.normal(0, noise_px);
        seen.pixel.y += rng.normal(0, noise_px);
      }
      problem.seen.push_back(seen);
    }
  }
  return problem;
}

}  // namespace tarsier::synth
