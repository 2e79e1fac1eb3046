// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/plane_sweeper.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tarsier::sfm {
namespace {

constexpr float kMinCosine = 0.17F;            // between normal and ray: 80 degrees
constexpr float kMaxReprojection = 3;          // px; larger errors do not cost more
constexpr float kCostSpread = 0.3F;            // spread of the costs of views that see the same
constexpr float kEqualPlaneMotion_px = 0.02F;  // px; planes closer than this are equal
// Small patches: their relative width; half of the min spacing of their samples, px of the larger
// images; the min variance of grey levels for sufficient accuracy (noise alone has 1 to 10).
constexpr float kSmallPatchWidth = 0.4F;
constexpr float kMinSpacing = 0.6F;
constexpr float kMinTexture = 30;

// Positions of the surrounding pixels whose planes are tried: the best one of each group. All have
// the other colour of the checkerboard: dx + dy is odd.
struct PixelOffset {
  int x;
  int y;
};
constexpr std::array<PixelOffset, 7> kNearOffsets{
    {{0, -1}, {-1, -2}, {1, -2}, {-2, -3}, {2, -3}, {-3, -4}, {3, -4}}};
constexpr std::array<PixelOffset, 10> kFarOffsets{{{0, -3},
                                                   {0, -5},
                                                   {0, -7},
                                                   {0, -9},
                                                   {0, -11},
                                                   {0, -13},
                                                   {0, -15},
                                                   {0, -17},
                                                   {0, -19},
                                                   {0, -21}}};

PixelOffset turned(PixelOffset offset, int quarter) {
  switch (quarter) {
    case 0:
      return offset;
    case 1:
      return {-offset.y, offset.x};
    case 2:
      return {-offset.x, -offset.y};
    default:
      return {offset.y, -offset.x};
  }
}

std::uint64_t splitmix64(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15U;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebU;
  return x ^ (x >> 31);
}

}  // namespace

class PlaneSweeper::Random {
 public:
  Random(std::uint64_t seed, std::size_t pixel, int round)
      : state_(splitmix64(
            splitmix64(seed ^ static_cast<std::uint64_t>(round) * 0x9e3779b97f4a7c15U) + pixel)) {}
  float uniform() {  // in [0, 1)
    state_ = splitmix64(state_);
    return static_cast<float>(state_ >> 40) * 0x1p-24F;
  }
  float symmetric() { return 2 * uniform() - 1; }  // in [-1, 1)

 private:
  std::uint64_t state_;
};

struct PlaneSweeper::Pixel {
  int x = 0;
  int y = 0;
  std::size_t index = 0;
  Patch patch;
  float patch_width = 1;  // relative width of the patch
  // the sources of the level that the patch is compared with
  const std::vector<SourceLevel>* compared = nullptr;
  std::array<std::array<float, 3>, kMaxSources> base{};        // to_source (x, y, 1)
  std::array<std::array<float, 3>, kMaxSources> large_base{};  // the same for the larger images
  Views views;
  Plane plane;     // best plane up to now
  float cost = 0;  // its cost over the views
  std::array<float, kMaxSources> costs{};
  std::array<bool, kMaxSources> is_known{};
  bool is_changed = false;
};

PlaneSweeper::PlaneSweeper(const MatchLevel& level, PlaneField& field, const Options& options)
    : level_(level),
      field_(field),
      options_(options),
      kernels_(patch_kernels()),
      gray_{level.gray.ptr(), static_cast<std::int64_t>(level.gray.step[0]), level.gray.cols,
            level.gray.rows} {
  TARSIER_REQUIRE(field.size == level.gray.size(), "a field of {}x{} for {}x{}", field.size.width,
                  field.size.height, level.gray.cols, level.gray.rows);
  TARSIER_REQUIRE(!level.sources.empty() && level.sources.size() <= kMaxSources &&
                      level.sources.size() == static_cast<std::size_t>(field.sources),
                  "{} sources", level.sources.size());
}

template <typename Work>
void PlaneSweeper::each_pixel(int colour, const std::stop_token& stop, const Work& work) {
  cv::parallel_for_(cv::Range(0, field_.size.height), [&](const cv::Range& rows) {
    Pixel pixel;
    for (int y = rows.start; y < rows.end; ++y) {
      if (stop.stop_requested()) return;
      const int first = colour < 0 ? 0 : (y + colour) % 2;
      for (int x = first; x < field_.size.width; x += colour < 0 ? 1 : 2) {
        load_pixel(x, y, pixel);
        work(pixel);
      }
    }
  });
  throw_if_stopped(stop);
}

void PlaneSweeper::load_pixel(int x, int y, Pixel& pixel) const {
  pixel.x = x;
  pixel.y = y;
  pixel.index = field_.index(x, y);
  pixel.plane = field_.planes[pixel.index];
  pixel.is_changed = false;
  const auto u = static_cast<float>(x);
  const auto v = static_cast<float>(y);
  pixel.compared = &level_.sources;
  pixel.patch_width = 1;
  if (!level_.large_sources.empty()) {
    const float scale_x =
        static_cast<float>(level_.large_size.width) / static_cast<float>(field_.size.width);
    const float scale_y =
        static_cast<float>(level_.large_size.height) / static_cast<float>(field_.size.height);
    const float patch_width = std::max(kSmallPatchWidth, kMinSpacing / scale_x);
    kernels_.prepare_interpolated(
        {level_.large_words.data(), level_.large_size.width, level_.large_size.height},
        (u + 0.5F) * scale_x - 0.5F, (v + 0.5F) * scale_y - 0.5F, patch_width * scale_x,
        pixel.patch);
    if (pixel.patch.variance >= kMinTexture) {
      pixel.compared = &level_.large_sources;
      pixel.patch_width = patch_width;
    }
  }
  if (pixel.patch_width == 1) kernels_.prepare(gray_, x, y, pixel.patch);
  const std::size_t sources = level_.sources.size();
  const std::uint16_t* costs = field_.view_costs.data() + pixel.index * sources;
  for (std::size_t s = 0; s < sources; ++s) {
    const auto projected = [&](const std::array<float, 9>& m) -> std::array<float, 3> {
      return {m[0] * u + m[1] * v + m[2], m[3] * u + m[4] * v + m[5], m[6] * u + m[7] * v + m[8]};
    };
    pixel.base[s] = projected(level_.sources[s].to_source);
    if (pixel.patch_width < 1) pixel.large_base[s] = projected(level_.large_sources[s].to_source);
    pixel.costs[s] = static_cast<float>(costs[s]) * (1 / PlaneField::kCostUnit);
    pixel.is_known[s] = true;
  }
}

// Chooses the sources that see the surroundings well, the best first.
void PlaneSweeper::choose_views(Pixel& pixel) const {
  const std::size_t sources = level_.sources.size();
  std::array<float, kMaxSources> score{};
  const auto add = [&](int x, int y) {
    const std::uint16_t* costs = field_.view_costs.data() + field_.index(x, y) * sources;
    for (std::size_t s = 0; s < sources; ++s) {
      const float cost = static_cast<float>(costs[s]) * (1 / (PlaneField::kCostUnit * kCostSpread));
      // Approximates exp(-c^2 / 2) without calling the function.
      const float part = 1 + cost * cost * 0.25F;
      score[s] += 1 / (part * part * part * part);
    }
  };
  add(pixel.x, pixel.y);
  if (pixel.x > 0) add(pixel.x - 1, pixel.y);
  if (pixel.y > 0) add(pixel.x, pixel.y - 1);
  if (pixel.x + 1 < field_.size.width) add(pixel.x + 1, pixel.y);
  if (pixel.y + 1 < field_.size.height) add(pixel.x, pixel.y + 1);
  Views& views = pixel.views;
  views.count = std::min(options_.best_views, static_cast<int>(sources));
  float total = 0;
  for (int k = 0; k < views.count; ++k) {
    std::size_t best = 0;
    for (std::size_t s = 1; s < sources; ++s)
      if (score[s] > score[best]) best = s;
    const auto index = static_cast<std::size_t>(k);
    views.source[index] = static_cast<int>(best);
    views.weight[index] = score[best] + 1e-3F;
    total += views.weight[index];
    score[best] = -1;
  }
  pixel.cost = 0;
  for (int k = 0; k < views.count; ++k) {
    const auto index = static_cast<std::size_t>(k);
    views.weight[index] /= total;
    pixel.cost += views.weight[index] * pixel.costs[static_cast<std::size_t>(views.source[index])];
  }
}

float PlaneSweeper::geometric_cost(const Pixel& pixel, const SourceLevel& source,
                                   const std::array<float, 3>& base, float inverse_depth) const {
  const float max_cost = options_.geometric_weight * kMaxReprojection;
  const float z = base[2] + source.to_source_w[2] * inverse_depth;
  if (!(z > 0)) return max_cost;
  const float u = (base[0] + source.to_source_w[0] * inverse_depth) / z;
  const float v = (base[1] + source.to_source_w[1] * inverse_depth) / z;
  const cv::Mat1f& map = source.inverse_depth;
  if (!(u >= 0 && v >= 0 && u < static_cast<float>(map.cols - 1) &&
        v < static_cast<float>(map.rows - 1)))
    return max_cost;
  const int x = static_cast<int>(u);
  const int y = static_cast<int>(v);
  const float right = u - static_cast<float>(x);
  const float down = v - static_cast<float>(y);
  const float* row = map[y] + x;
  const float* next = map[y + 1] + x;
  const float low = std::min({row[0], row[1], next[0], next[1]});
  const float high = std::max({row[0], row[1], next[0], next[1]});
  // At a depth edge the nearest pixel is used.
  const float there = low > 0 && high < 1.05F * low
                          ? (row[0] + right * (row[1] - row[0])) * (1 - down) +
                                (next[0] + right * (next[1] - next[0])) * down
                          : (down < 0.5F ? row : next)[right < 0.5F ? 0 : 1];
  if (!(there > 0)) return max_cost;
  const std::array<float, 9>& m = source.to_reference;
  const std::array<float, 3>& w = source.to_reference_w;
  const float back = m[6] * u + m[7] * v + m[8] + w[2] * there;
  if (!(back > 0)) return max_cost;
  const float dx = (m[0] * u + m[1] * v + m[2] + w[0] * there) / back - static_cast<float>(pixel.x);
  const float dy = (m[3] * u + m[4] * v + m[5] + w[1] * there) / back - static_cast<float>(pixel.y);
  return std::min(max_cost, options_.geometric_weight * std::sqrt(dx * dx + dy * dy));
}

float PlaneSweeper::view_cost(const Pixel& pixel, int index, const Plane& plane) const {
  const auto s = static_cast<std::size_t>(index);
  const SourceLevel& compared = (*pixel.compared)[s];
  const std::array<float, 9>& m = compared.to_source;
  const std::array<float, 3>& t = compared.to_source_w;
  const std::array<float, 3>& base = pixel.patch_width < 1 ? pixel.large_base[s] : pixel.base[s];
  const float x = pixel.patch_width;
  const float h[9] = {base[0] + t[0] * plane.inverse_depth, x * (m[0] + t[0] * plane.slope_x),
                      x * (m[1] + t[0] * plane.slope_y),    base[1] + t[1] * plane.inverse_depth,
                      x * (m[3] + t[1] * plane.slope_x),    x * (m[4] + t[1] * plane.slope_y),
                      base[2] + t[2] * plane.inverse_depth, x * (m[6] + t[2] * plane.slope_x),
                      x * (m[7] + t[2] * plane.slope_y)};
  float cost = kernels_.cost(pixel.patch, compared.quads(), h);
  const SourceLevel& source = level_.sources[s];
  if (!source.inverse_depth.empty())
    cost += geometric_cost(pixel, source, pixel.base[s], plane.inverse_depth);
  return cost;
}

// Whether the depth is in the range and the angle between ray and normal at most 80 degrees.
bool PlaneSweeper::is_valid(const Pixel& pixel, const Plane& plane) const {
  if (!(plane.inverse_depth >= level_.min_inverse_depth &&
        plane.inverse_depth <= level_.max_inverse_depth))
    return false;
  const auto& camera = level_.camera;
  const auto dx = static_cast<float>(pixel.x - camera.cx);
  const auto dy = static_cast<float>(pixel.y - camera.cy);
  const auto fx = static_cast<float>(camera.fx);
  const auto fy = static_cast<float>(camera.fy);
  const float a = plane.slope_x * fx;
  const float b = plane.slope_y * fy;
  const float c = plane.inverse_depth - plane.slope_x * dx - plane.slope_y * dy;
  const float ray = dx * dx / (fx * fx) + dy * dy / (fy * fy) + 1;
  const float w = plane.inverse_depth;
  return w * w > kMinCosine * kMinCosine * (a * a + b * b + c * c) * ray;
}

bool PlaneSweeper::try_plane(Pixel& pixel, const Plane& plane) const {
  if (!is_valid(pixel, plane)) return false;
  std::array<float, kMaxSources> costs{};
  float total = 0;
  for (int k = 0; k < pixel.views.count; ++k) {
    const auto index = static_cast<std::size_t>(k);
    costs[index] = view_cost(pixel, pixel.views.source[index], plane);
    total += pixel.views.weight[index] * costs[index];
    if (!(total < pixel.cost)) return false;
  }
  pixel.cost = total;
  pixel.plane = plane;
  pixel.is_changed = true;
  pixel.is_known.fill(false);
  for (int k = 0; k < pixel.views.count; ++k) {
    const auto index = static_cast<std::size_t>(k);
    const auto source = static_cast<std::size_t>(pixel.views.source[index]);
    pixel.costs[source] = costs[index];
    pixel.is_known[source] = true;
  }
  return true;
}

void PlaneSweeper::store(const Pixel& pixel) {
  field_.costs[pixel.index] = pixel.cost;
  if (!pixel.is_changed) return;
  field_.planes[pixel.index] = pixel.plane;
  std::uint16_t* costs = field_.view_costs.data() + pixel.index * level_.sources.size();
  for (std::size_t s = 0; s < level_.sources.size(); ++s) {
    const float cost =
        pixel.is_known[s] ? pixel.costs[s] : view_cost(pixel, static_cast<int>(s), pixel.plane);
    costs[s] = static_cast<std::uint16_t>(cost * PlaneField::kCostUnit + 0.5F);
  }
}

// Motion in px of the pixel's projection in its best view, per unit of inverse depth.
float PlaneSweeper::motion_of(const Pixel& pixel) const {
  const auto s = static_cast<std::size_t>(pixel.views.source[0]);
  const std::array<float, 3>& t = level_.sources[s].to_source_w;
  const std::array<float, 3>& base = pixel.base[s];
  const float w = pixel.plane.inverse_depth;
  const float z = std::max(base[2] + t[2] * w, 1e-6F);
  const float dx = (t[0] - (base[0] + t[0] * w) / z * t[2]) / z;
  const float dy = (t[1] - (base[1] + t[1] * w) / z * t[2]) / z;
  return std::max(std::sqrt(dx * dx + dy * dy), 1e-6F);
}

// A random depth, uniform by its inverse, and a normal within 70 degrees of the ray.
Plane PlaneSweeper::random_plane(const Pixel& pixel, Random& random) const {
  const float w = level_.min_inverse_depth +
                  random.uniform() * (level_.max_inverse_depth - level_.min_inverse_depth);
  const auto& camera = level_.camera;
  const float cosine = 1 - random.uniform() * 0.66F;
  const float sine = std::sqrt(1 - cosine * cosine);
  const float angle = 2 * std::numbers::pi_v<float> * random.uniform();
  cv::Vec3f ray(static_cast<float>((pixel.x - camera.cx) / camera.fx),
                static_cast<float>((pixel.y - camera.cy) / camera.fy), 1);
  ray *= -1 / std::sqrt(ray.dot(ray));
  cv::Vec3f across(ray[2], 0, -ray[0]);
  across *= 1 / std::sqrt(across.dot(across));
  const cv::Vec3f up = ray.cross(across);
  const cv::Vec3f normal = cosine * ray + sine * (std::cos(angle) * across + std::sin(angle) * up);
  return plane_of(camera, pixel.x, pixel.y, w, normal);
}

void PlaneSweeper::propagate(Pixel& pixel) const {
  const float motion = motion_of(pixel);
  std::array<Plane, 9> candidates;
  std::size_t count = 0;
  candidates[count++] = pixel.plane;
  const auto try_best_of = [&](const auto& offsets, int quarter) {
    float best = kMaxCost * 2;
    PixelOffset from{0, 0};
    for (const PixelOffset& offset : offsets) {
      const PixelOffset at = turned(offset, quarter);
      const int x = pixel.x + at.x;
      const int y = pixel.y + at.y;
      if (x < 0 || y < 0 || x >= field_.size.width || y >= field_.size.height) continue;
      const float cost = field_.costs[field_.index(x, y)];
      if (cost < best) {
        best = cost;
        from = at;
      }
    }
    if (from.x == 0 && from.y == 0) return;
    Plane plane = field_.planes[field_.index(pixel.x + from.x, pixel.y + from.y)];
    plane.inverse_depth -=
        plane.slope_x * static_cast<float>(from.x) + plane.slope_y * static_cast<float>(from.y);
    for (std::size_t i = 0; i < count; ++i) {
      const float difference = std::abs(plane.inverse_depth - candidates[i].inverse_depth) +
                               kPatchRadius * (std::abs(plane.slope_x - candidates[i].slope_x) +
                                               std::abs(plane.slope_y - candidates[i].slope_y));
      if (difference * motion < kEqualPlaneMotion_px) return;
    }
    candidates[count++] = plane;
    (void)try_plane(pixel, plane);
  };
  for (int quarter = 0; quarter < 4; ++quarter) try_best_of(kNearOffsets, quarter);
  for (int quarter = 0; quarter < 4; ++quarter) try_best_of(kFarOffsets, quarter);
}

void PlaneSweeper::perturb(Pixel& pixel, float motion, int changes, int round) const {
  Random random(options_.seed, pixel.index, round);
  for (int i = 0; i < changes; ++i) {
    Plane plane = pixel.plane;
    if (i % 4 == 3) {  // a distant depth, as of a surface behind or in front
      plane = random_plane(pixel, random);
    } else {
      const float unit = motion / motion_of(pixel);
      if (i % 4 != 1) plane.inverse_depth += unit * random.symmetric();
      if (i % 4 != 0) {
        plane.slope_x += unit / kPatchRadius * random.symmetric();
        plane.slope_y += unit / kPatchRadius * random.symmetric();
      }
    }
    (void)try_plane(pixel, plane);
  }
}

void PlaneSweeper::score(const std::stop_token& stop) {
  each_pixel(-1, stop, [&](Pixel& pixel) {
    pixel.plane.inverse_depth =
        std::clamp(pixel.plane.inverse_depth, level_.min_inverse_depth, level_.max_inverse_depth);
    if (!is_valid(pixel, pixel.plane)) pixel.plane.slope_x = pixel.plane.slope_y = 0;
    const int sources = field_.sources;
    std::array<float, kMaxSources> sorted{};
    for (int s = 0; s < sources; ++s) {
      const auto index = static_cast<std::size_t>(s);
      sorted[index] = pixel.costs[index] = view_cost(pixel, s, pixel.plane);
    }
    const int count = std::min(options_.best_views, sources);
    std::partial_sort(sorted.begin(), sorted.begin() + count, sorted.begin() + sources);
    pixel.cost = 0;
    for (int k = 0; k < count; ++k)
      pixel.cost += sorted[static_cast<std::size_t>(k)] / static_cast<float>(count);
    pixel.is_changed = true;
    store(pixel);
  });
}

void PlaneSweeper::try_random(int count, const std::stop_token& stop) {
  each_pixel(-1, stop, [&](Pixel& pixel) {
    Random random(options_.seed, pixel.index, -1);
    const std::size_t sources = level_.sources.size();
    const auto best_count =
        static_cast<std::size_t>(std::min(options_.best_views, static_cast<int>(sources)));
    pixel.cost = field_.costs[pixel.index];
    for (int i = 0; i < count; ++i) {
      const Plane plane = random_plane(pixel, random);
      std::array<float, kMaxSources> costs{};
      for (std::size_t s = 0; s < sources; ++s)
        costs[s] = view_cost(pixel, static_cast<int>(s), plane);
      std::array<float, kMaxSources> sorted = costs;
      std::partial_sort(sorted.begin(), sorted.begin() + best_count, sorted.begin() + sources);
      float cost = 0;
      for (std::size_t k = 0; k < best_count; ++k)
        cost += sorted[k] / static_cast<float>(best_count);
      if (cost < pixel.cost) {
        pixel.cost = cost;
        pixel.plane = plane;
        pixel.costs = costs;
        pixel.is_changed = true;
      }
    }
    store(pixel);
  });
}

void PlaneSweeper::sweep(int round, float motion, int changes, const std::stop_token& stop) {
  for (int colour = 0; colour < 2; ++colour) {
    each_pixel(colour, stop, [&](Pixel& pixel) {
      choose_views(pixel);
      propagate(pixel);
      perturb(pixel, motion, changes, round);
      store(pixel);
    });
  }
}

void PlaneSweeper::refine(float step, const std::stop_token& stop) {
  for (int colour = 0; colour < 2; ++colour) {
    each_pixel(colour, stop, [&](Pixel& pixel) {
      choose_views(pixel);
      const float unit = step / motion_of(pixel);
      const Plane start = pixel.plane;
      const auto cost_at = [&](float offset) {
        Plane plane = start;
        plane.inverse_depth += offset;
        float total = 0;
        for (int k = 0; k < pixel.views.count; ++k) {
          const auto index = static_cast<std::size_t>(k);
          total += pixel.views.weight[index] * view_cost(pixel, pixel.views.source[index], plane);
        }
        return total;
      };
      const float before = cost_at(-unit);
      const float after = cost_at(unit);
      const float curvature = before + after - 2 * pixel.cost;
      float offset = before < after ? -unit : unit;
      if (curvature > 1e-6F)
        offset = std::clamp(0.5F * (before - after) / curvature, -1.5F, 1.5F) * unit;
      Plane plane = start;
      plane.inverse_depth += offset;
      (void)try_plane(pixel, plane);
      store(pixel);
    });
  }
}

}  // namespace tarsier::sfm
