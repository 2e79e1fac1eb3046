// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/texture.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/surface/atlas.h"
#include "tarsier/sfm/surface/seam_levelling.h"
#include "tarsier/sfm/surface/view_scan.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace tarsier::sfm {
namespace {

constexpr int kPadding_px = 3;          // px of the texture around a chart
constexpr int kTile_px = 6;             // px, size of the patch for a face that no image shows
constexpr double kScaleStep = 0.93;     // reduction per attempt to place the charts
constexpr double kMaxFillShare = 0.85;  // max share of the texture that rectangles fill
constexpr double kMinScale = 0.01;

struct Chart {
  int view = 0;
  std::vector<int> faces;
  std::map<int, int> uv_of;       // by vertex
  cv::Point2d low{1e300, 1e300};  // px of the image
  cv::Point2d high{-1e300, -1e300};
  cv::Rect source;  // px of the image, with the padding; may reach outside of it
  cv::Rect target;  // px of the texture
  // Converts px of the image to px of the texture.
  [[nodiscard]] cv::Point2d in_texture(const cv::Point2d& p) const {
    return {(p.x - source.x + 0.5) * target.width / source.width - 0.5 + target.x,
            (p.y - source.y + 0.5) * target.height / source.height - 0.5 + target.y};
  }
};

class Painter {
 public:
  Painter(const TextureJob& job, Progress& progress, const std::stop_token& stop)
      : job_(job), progress_(progress), stop_(stop), neighbors_(face_neighbors(job.mesh)) {}

  SurfaceTexture run() {
    find_charts();
    find_nodes();
    pack_charts();
    paint();
    if (job_.level) level();
    paint_unseen();
    set_uvs();
    return std::move(result_);
  }

 private:
  [[nodiscard]] int view_of(int face) const { return job_.views[at(face)]; }
  [[nodiscard]] const Face& face(int f) const { return job_.mesh.faces[at(f)]; }
  [[nodiscard]] cv::Point2d pixel(int view, int vertex) const {
    const Eigen::Vector3d x =
        job_.workspace.pose(view) * Eigen::Vector3d(job_.mesh.vertices[at(vertex)].cast<double>());
    const geometry::Camera& camera = job_.workspace.camera(view);
    return {camera.fx * x[0] / x[2] + camera.cx, camera.fy * x[1] / x[2] + camera.cy};
  }

  void find_charts() {
    chart_of_.assign(job_.mesh.faces.size(), -1);
    charts_of_view_.resize(at(job_.workspace.count()));
    for (int start = 0; start < static_cast<int>(chart_of_.size()); ++start) {
      if (view_of(start) < 0) {
        unseen_.push_back(start);
        continue;
      }
      if (chart_of_[at(start)] >= 0) continue;
      const int number = static_cast<int>(charts_.size());
      Chart chart;
      chart.view = view_of(start);
      chart.faces.push_back(start);
      chart_of_[at(start)] = number;
      for (std::size_t i = 0; i < chart.faces.size(); ++i) {
        for (const int other : neighbors_[at(chart.faces[i])]) {
          if (other < 0 || chart_of_[at(other)] >= 0 || view_of(other) != chart.view) continue;
          chart_of_[at(other)] = number;
          chart.faces.push_back(other);
        }
      }
      std::sort(chart.faces.begin(), chart.faces.end());
      for (const int f : chart.faces) {
        for (const int v : face(f)) {
          if (!chart.uv_of.emplace(v, 0).second) continue;
          const cv::Point2d p = pixel(chart.view, v);
          chart.low = {std::min(chart.low.x, p.x), std::min(chart.low.y, p.y)};
          chart.high = {std::max(chart.high.x, p.x), std::max(chart.high.y, p.y)};
        }
      }
      charts_of_view_[at(chart.view)].push_back(number);
      charts_.push_back(std::move(chart));
    }
    result_.charts = static_cast<int>(charts_.size());
  }

  // Creates a node per chart and vertex, numbered consecutively within a chart.
  void find_nodes() {
    for (Chart& chart : charts_) {
      for (auto& [vertex, node] : chart.uv_of) {
        node = static_cast<int>(vertices_.size());
        vertices_.push_back(vertex);
      }
    }
    sums_.assign(vertices_.size(), cv::Vec4f::all(0));
  }

  bool try_pack(double scale) {
    std::vector<cv::Size> sizes;
    for (Chart& chart : charts_) {
      const int around = static_cast<int>(std::ceil((kPadding_px + 1) / scale));
      const cv::Point low(static_cast<int>(std::floor(chart.low.x)) - around,
                          static_cast<int>(std::floor(chart.low.y)) - around);
      const cv::Point high(static_cast<int>(std::ceil(chart.high.x)) + around + 1,
                           static_cast<int>(std::ceil(chart.high.y)) + around + 1);
      chart.source = {low, high};
      sizes.emplace_back(std::max(1, static_cast<int>(std::lround(chart.source.width * scale))),
                         std::max(1, static_cast<int>(std::lround(chart.source.height * scale))));
    }
    tiles_across_ =
        std::min(job_.size / kTile_px,
                 static_cast<int>(std::ceil(std::sqrt(static_cast<double>(unseen_.size())))));
    if (!unseen_.empty()) {
      const int rows = (static_cast<int>(unseen_.size()) + tiles_across_ - 1) / tiles_across_;
      sizes.emplace_back(tiles_across_ * kTile_px, rows * kTile_px);
    }
    const auto corners = pack(sizes, job_.size);
    if (!corners) return false;
    int width = 1;
    int height = 1;
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      const cv::Rect rect((*corners)[i], sizes[i]);
      (i < charts_.size() ? charts_[i].target : unseen_rect_) = rect;
      width = std::max(width, rect.br().x);
      height = std::max(height, rect.br().y);
    }
    result_.image = cv::Mat(height, width, CV_8UC3, cv::Scalar::all(128));
    return true;
  }

  void pack_charts() {
    double area = 1;
    for (const Chart& chart : charts_)
      area += (chart.high.x - chart.low.x + 10) * (chart.high.y - chart.low.y + 10);
    const double capacity = kMaxFillShare * static_cast<double>(job_.size) * job_.size;
    double scale = std::min(1.0, std::sqrt(capacity / area));
    while (!try_pack(scale)) {
      throw_if_stopped(stop_);
      scale *= kScaleStep;
      if (scale < kMinScale)
        throw UsageError(
            fmt::format("{} parts of the surface do not fit into a texture of {} px: set a larger "
                        "texture (option 'texture') or fewer faces (option 'faces')",
                        charts_.size(), job_.size));
    }
    result_.scale = scale;
  }

  [[nodiscard]] int node(int face_index, int vertex) const {
    return charts_[at(chart_of_[at(face_index)])].uv_of.at(vertex);
  }

  // Adds the mean colour along the half of each seam edge that begins at a vertex.
  void sample_seams(const Chart& chart, const cv::Mat& image) {
    for (const int f : chart.faces) {
      for (std::size_t k = 0; k < 3; ++k) {
        const int other = neighbors_[at(f)][k];
        if (other < 0 || view_of(other) < 0 || chart_of_[at(other)] == chart_of_[at(f)]) continue;
        const int a = face(f)[k];
        const int b = face(f)[(k + 1) % 3];
        const cv::Point2d p = pixel(chart.view, a);
        const cv::Point2d q = pixel(chart.view, b);
        constexpr int kSteps = 8;
        for (int i = 0; i <= kSteps; ++i) {
          const double part = static_cast<double>(i) / kSteps;
          const cv::Vec3f color = color_at(image, p + (q - p) * part);
          const auto add = [&](int vertex, double weight) {
            const auto w = static_cast<float>(weight);
            sums_[at(chart.uv_of.at(vertex))] +=
                cv::Vec4f(color[0] * w, color[1] * w, color[2] * w, w);
          };
          if (part <= 0.5) add(a, 1 - part);
          if (part >= 0.5) add(b, part);
        }
      }
    }
  }

  void paint() {
    progress_.begin("texture", job_.workspace.count(), "images");
    for (int view = 0; view < job_.workspace.count(); ++view) {
      throw_if_stopped(stop_);
      progress_.advance();
      if (charts_of_view_[at(view)].empty()) continue;
      const cv::Mat image = job_.workspace.read_image(view);
      const cv::Rect bounds({0, 0}, image.size());
      cv::Mat blurred;
      cv::blur(image, blurred, {3, 3});
      for (const int number : charts_of_view_[at(view)]) {
        const Chart& chart = charts_[at(number)];
        const cv::Rect visible = chart.source & bounds;
        if (visible.empty()) continue;
        cv::Mat source;
        cv::copyMakeBorder(image(visible), source, visible.y - chart.source.y,
                           chart.source.br().y - visible.br().y, visible.x - chart.source.x,
                           chart.source.br().x - visible.br().x,
                           cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
        cv::Mat target = result_.image(chart.target);
        cv::resize(source, target, target.size(), 0, 0, cv::INTER_AREA);
        sample_seams(chart, blurred);
      }
    }
    progress_.end();
  }

  [[nodiscard]] std::vector<cv::Vec3f> offsets() const {
    SeamProblem problem;
    problem.nodes = static_cast<int>(vertices_.size());
    std::vector<std::pair<int, int>> pairs;  // nodes on both sides of a seam
    for (int f = 0; f < static_cast<int>(chart_of_.size()); ++f) {
      if (view_of(f) < 0) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        const int other = neighbors_[at(f)][k];
        const int a = face(f)[k];
        const int b = face(f)[(k + 1) % 3];
        if (other < 0 || view_of(other) < 0) continue;
        if (chart_of_[at(other)] == chart_of_[at(f)]) {
          if (f < other) problem.edges.emplace_back(node(f, a), node(f, b));
        } else if (f < other) {
          for (const int v : {a, b}) pairs.emplace_back(node(f, v), node(other, v));
        }
      }
    }
    for (auto& [a, b] : pairs)
      if (a > b) std::swap(a, b);
    std::sort(pairs.begin(), pairs.end());
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
    for (const auto& [a, b] : pairs) {
      const cv::Vec4f& fa = sums_[at(a)];
      const cv::Vec4f& fb = sums_[at(b)];
      if (!(fa[3] > 0 && fb[3] > 0)) continue;
      cv::Vec3f step;
      for (int k = 0; k < 3; ++k) step[k] = fb[k] / fb[3] - fa[k] / fa[3];
      problem.seams.push_back({a, b, step});
    }
    return level_seams(problem);
  }

  // Interpolates the offsets within each face. Other pixels of the padding take the nearest.
  void level() {
    throw_if_stopped(stop_);
    const std::vector<cv::Vec3f> all = offsets();
    cv::parallel_for_(cv::Range(0, static_cast<int>(charts_.size())), [&](const cv::Range& range) {
      for (int c = range.start; c < range.end; ++c) add_offsets(charts_[at(c)], all);
    });
  }

  void add_offsets(const Chart& chart, const std::vector<cv::Vec3f>& all) {
    cv::Mat3f offset(chart.target.size(), cv::Vec3f::all(0));
    cv::Mat1b known(chart.target.size(), static_cast<unsigned char>(0));
    for (const int f : chart.faces) draw_offsets(chart, f, all, offset, known);
    for (int step = 0; step <= kPadding_px; ++step) spread(offset, known);
    // Pixels farther outside are unused: a uniform colour compresses better.
    cv::Mat image = result_.image(chart.target);
    const cv::Scalar mean = cv::mean(image, known);
    for (int y = 0; y < image.rows; ++y) {
      auto* row = image.ptr<cv::Vec3b>(y);
      for (int x = 0; x < image.cols; ++x) {
        for (int k = 0; k < 3; ++k) {
          row[x][k] =
              known(y, x) != 0
                  ? cv::saturate_cast<std::uint8_t>(static_cast<float>(row[x][k]) + offset(y, x)[k])
                  : cv::saturate_cast<std::uint8_t>(mean[k]);
        }
      }
    }
  }

  void draw_offsets(const Chart& chart, int f, const std::vector<cv::Vec3f>& all, cv::Mat3f& offset,
                    cv::Mat1b& known) const {
    std::array<cv::Point2d, 3> p;
    std::array<cv::Vec3f, 3> g;
    for (std::size_t k = 0; k < 3; ++k) {
      const int v = face(f)[k];
      p[k] = chart.in_texture(pixel(chart.view, v)) - cv::Point2d(chart.target.tl());
      g[k] = all[at(chart.uv_of.at(v))];
    }
    const double area = (p[1] - p[0]).cross(p[2] - p[0]);
    const auto [left, right] = std::minmax({p[0].x, p[1].x, p[2].x});
    const auto [top, bottom] = std::minmax({p[0].y, p[1].y, p[2].y});
    // Half a pixel of margin, so that no pixel between faces is missed.
    const double margin =
        std::abs(area) > 1e-9 ? 0.6 * std::max(right - left, bottom - top) / std::abs(area) : 0;
    for (int y = std::max(0, static_cast<int>(std::floor(top)));
         y <= std::min(offset.rows - 1, static_cast<int>(std::ceil(bottom))); ++y) {
      for (int x = std::max(0, static_cast<int>(std::floor(left)));
           x <= std::min(offset.cols - 1, static_cast<int>(std::ceil(right))); ++x) {
        const cv::Point2d here(x, y);
        double a = 1.0 / 3;
        double b = 1.0 / 3;
        if (margin > 0) {
          a = (p[1] - here).cross(p[2] - here) / area;
          b = (p[2] - here).cross(p[0] - here) / area;
          if (std::min({a, b, 1 - a - b}) < -margin) continue;
          const bool is_inside = std::min({a, b, 1 - a - b}) >= 0;
          if (known(y, x) != 0 && !is_inside) continue;
          a = std::clamp(a, 0.0, 1.0);
          b = std::clamp(b, 0.0, 1.0 - a);
        }
        offset(y, x) = g[0] * static_cast<float>(a) + g[1] * static_cast<float>(b) +
                       g[2] * static_cast<float>(1 - a - b);
        known(y, x) = 255;
      }
    }
  }

  static void spread(cv::Mat3f& offset, cv::Mat1b& known) {
    const cv::Mat1b before = known.clone();
    for (int y = 0; y < offset.rows; ++y) {
      for (int x = 0; x < offset.cols; ++x) {
        if (before(y, x) != 0) continue;
        cv::Vec3f sum(0, 0, 0);
        int count = 0;
        for (int j = std::max(0, y - 1); j <= std::min(offset.rows - 1, y + 1); ++j) {
          for (int i = std::max(0, x - 1); i <= std::min(offset.cols - 1, x + 1); ++i) {
            if (before(j, i) == 0) continue;
            sum += offset(j, i);
            ++count;
          }
        }
        if (count == 0) continue;
        offset(y, x) = sum * (1.0F / static_cast<float>(count));
        known(y, x) = 255;
      }
    }
  }

  [[nodiscard]] cv::Point tile_of(std::size_t number) const {
    const int i = static_cast<int>(number);
    return unseen_rect_.tl() + kTile_px * cv::Point(i % tiles_across_, i / tiles_across_);
  }

  void paint_unseen() {
    for (std::size_t i = 0; i < unseen_.size(); ++i) {
      std::array<cv::Vec3f, 3> colors;
      for (std::size_t k = 0; k < 3; ++k) {
        colors[k] = job_.mesh.colors.empty() ? cv::Vec3f::all(128)
                                             : cv::Vec3f(job_.mesh.colors[at(face(unseen_[i])[k])]);
      }
      for (int y = 0; y < kTile_px; ++y) {
        for (int x = 0; x < kTile_px; ++x) {
          const float b = std::clamp((static_cast<float>(x) - 1) / (kTile_px - 3), 0.0F, 1.0F);
          const float c = std::clamp((static_cast<float>(y) - 1) / (kTile_px - 3), 0.0F, 1.0F - b);
          result_.image.at<cv::Vec3b>(tile_of(i) + cv::Point(x, y)) =
              cv::Vec3b(colors[0] * (1 - b - c) + colors[1] * b + colors[2] * c);
        }
      }
    }
  }

  [[nodiscard]] cv::Vec2f uv_of(const cv::Point2d& p) const {
    return {static_cast<float>((p.x + 0.5) / result_.image.cols),
            static_cast<float>(1 - (p.y + 0.5) / result_.image.rows)};
  }

  void set_uvs() {
    result_.corners.resize(job_.mesh.faces.size());
    for (const Chart& chart : charts_) {
      for (const auto& [vertex, node] : chart.uv_of) {
        (void)node;
        result_.uvs.push_back(uv_of(chart.in_texture(pixel(chart.view, vertex))));
      }
      for (const int f : chart.faces)
        for (std::size_t k = 0; k < 3; ++k) result_.corners[at(f)][k] = chart.uv_of.at(face(f)[k]);
    }
    for (std::size_t i = 0; i < unseen_.size(); ++i) {
      const cv::Point2d corner = tile_of(i);
      const int first = static_cast<int>(result_.uvs.size());
      result_.corners[at(unseen_[i])] = {first, first + 1, first + 2};
      result_.uvs.push_back(uv_of(corner + cv::Point2d(1, 1)));
      result_.uvs.push_back(uv_of(corner + cv::Point2d(kTile_px - 2, 1)));
      result_.uvs.push_back(uv_of(corner + cv::Point2d(1, kTile_px - 2)));
    }
  }

  const TextureJob& job_;
  Progress& progress_;
  const std::stop_token& stop_;
  std::vector<Face> neighbors_;
  std::vector<Chart> charts_;
  std::vector<int> chart_of_;  // for each face; -1: none
  std::vector<std::vector<int>> charts_of_view_;
  std::vector<int> unseen_;  // indices of faces
  cv::Rect unseen_rect_;
  int tiles_across_ = 1;
  std::vector<int> vertices_;    // for each node
  std::vector<cv::Vec4f> sums_;  // for each node: sum of colours along seams, and weight
  SurfaceTexture result_;
};

}  // namespace

SurfaceTexture make_surface_texture(const TextureJob& job, Progress& progress,
                                    const std::stop_token& stop) {
  TARSIER_REQUIRE(job.size >= 64 && job.size <= 16384, "texture of {} px: expected 64..16384",
                  job.size);
  TARSIER_REQUIRE(job.views.size() == job.mesh.faces.size(), "{} views for {} faces",
                  job.views.size(), job.mesh.faces.size());
  return Painter(job, progress, stop).run();
}

}  // namespace tarsier::sfm
