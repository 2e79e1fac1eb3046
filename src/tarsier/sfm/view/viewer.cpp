// SPDX-License-Identifier: MIT
#include "viewer.h"

#include "tarsier/core/base64.h"
#include "tarsier/core/markup.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"

#include <fmt/format.h>

#include "assets.h"
#include "framing.h"
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

static_assert(std::endian::native == std::endian::little, "the page reads little endian numbers");

constexpr double kMaxExtent = 8;  // scales from the centre; the range of the 16-bit positions
constexpr int kMaxCloudPoints = 400'000;

// JSON that is safe in a script element: nothing in it can end that element.
std::string json_in_script(const nlohmann::json& json) {
  const std::string text = json.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
  std::string result;
  result.reserve(text.size());
  for (const char c : text) {
    if (c == '<' || c == '>' || c == '&')
      result += fmt::format("\\u{:04x}", static_cast<int>(c));
    else
      result += c;
  }
  return result;
}

// 12345 -> 12,345
std::string grouped(std::size_t number) {
  std::string text = fmt::format("{}", number);
  for (std::ptrdiff_t at = static_cast<std::ptrdiff_t>(text.size()) - 3; at > 0; at -= 3)
    text.insert(static_cast<std::size_t>(at), 1, ',');
  return text;
}

std::string counted(std::size_t number, std::string_view one, std::string_view many) {
  return fmt::format("{} {}", grouped(number), number == 1 ? one : many);
}

// The page's frame: x right, y up, in units of the radius.
struct Frame {
  Framing framing;
  [[nodiscard]] Eigen::Vector3d of(const Eigen::Vector3d& world) const {
    return framing.framed(world) / framing.scale();
  }
};

template <typename T>
std::string base64_of(const std::vector<T>& values) {
  return to_base64(
      std::span(reinterpret_cast<const std::uint8_t*>(values.data()), values.size() * sizeof(T)));
}

// Points with 16 bits per coordinate; at most `max_points`, evenly selected. `position(i)`: world,
// `color(i)`: BGR.
template <typename Position, typename Color>
nlohmann::json cloud_json(std::size_t count, const Frame& frame, int max_points,
                          const Position& position, const Color& color) {
  std::vector<std::size_t> order;
  double range = 1;
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3d framed = frame.of(position(i));
    const double extent = framed.cwiseAbs().maxCoeff();
    if (!(extent <= kMaxExtent) || !framed.allFinite()) continue;
    range = std::max(range, extent);
    order.push_back(i);
  }
  // Shuffled, so that any first part is an even selection: without WebGL the page draws fewer
  // points.
  Rng random(1);
  for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random() % i]);
  if (order.size() > static_cast<std::size_t>(max_points))
    order.resize(static_cast<std::size_t>(max_points));
  std::vector<std::uint16_t> positions;
  std::vector<std::uint8_t> colors;
  for (const std::size_t i : order) {
    const Eigen::Vector3d framed = frame.of(position(i));
    for (int k = 0; k < 3; ++k) {
      positions.push_back(
          static_cast<std::uint16_t>(std::lround((framed[k] / range + 1) * 32767.5)));
      colors.push_back(color(i)[2 - k]);
    }
  }
  return {{"drawn", order.size()},
          {"range", range},
          {"positions", base64_of(positions)},
          {"colors", base64_of(colors)}};
}

void check(const ViewerLayers& layers) {
  TARSIER_REQUIRE(layers.cloud.colors.size() == layers.cloud.positions.size(),
                  "{} colours for {} points", layers.cloud.colors.size(),
                  layers.cloud.positions.size());
  const ViewerSurface& surface = layers.surface;
  TARSIER_REQUIRE(surface.colors.size() == surface.vertices.size(), "{} colours for {} vertices",
                  surface.colors.size(), surface.vertices.size());
  TARSIER_REQUIRE(surface.indices.size() % 3 == 0, "{} indices of face corners",
                  surface.indices.size());
  TARSIER_REQUIRE(surface.texture.empty() || surface.uvs.size() == surface.vertices.size(),
                  "{} texture coordinates for {} vertices", surface.uvs.size(),
                  surface.vertices.size());
  for (const std::uint32_t index : surface.indices)
    TARSIER_REQUIRE(index < surface.vertices.size(), "vertex {} of {}", index,
                    surface.vertices.size());
}

nlohmann::json surface_json(const ViewerSurface& surface, const Frame& frame) {
  std::vector<float> positions;
  std::vector<std::uint8_t> colors;
  std::vector<bool> is_drawn;
  for (std::size_t i = 0; i < surface.vertices.size(); ++i) {
    const Eigen::Vector3d framed = frame.of(surface.vertices[i].cast<double>());
    is_drawn.push_back(framed.allFinite() && framed.cwiseAbs().maxCoeff() <= kMaxExtent);
    for (int k = 0; k < 3; ++k) {
      positions.push_back(is_drawn.back() ? static_cast<float>(framed[k]) : 0.F);
      colors.push_back(surface.colors[i][2 - k]);
    }
  }
  std::vector<std::uint32_t> indices;
  for (std::size_t f = 0; f < surface.indices.size(); f += 3) {
    const auto corners = std::span(surface.indices).subspan(f, 3);
    if (std::all_of(corners.begin(), corners.end(), [&](std::uint32_t v) { return is_drawn[v]; }))
      indices.insert(indices.end(), corners.begin(), corners.end());
  }
  nlohmann::json json{{"positions", base64_of(positions)},
                      {"colors", base64_of(colors)},
                      {"indices", base64_of(indices)}};
  if (!surface.texture.empty()) {
    std::vector<float> uvs;
    for (const cv::Vec2f& uv : surface.uvs) uvs.insert(uvs.end(), {uv[0], uv[1]});
    json["uvs"] = base64_of(uvs);
    json["texture"] = to_base64(surface.texture);
  }
  return json;
}

std::string layer_button(const char* layer, const char* label) {
  return fmt::format(
      "<button type=\"button\" class=\"tv-layer\" data-layer=\"{}\" "
      "aria-pressed=\"false\">{}</button>",
      layer, label);
}

// Six sliders: lower and upper limit of each axis.
std::string clipping_panel() {
  std::string panel = "<div class=\"tv-cut\" hidden>";
  for (const auto& [low, high] :
       {std::pair("left", "right"), std::pair("below", "above"), std::pair("back", "front")}) {
    for (const auto& [name, value] : {std::pair(low, 0), std::pair(high, 1000)}) {
      panel +=
          fmt::format("<label>{}<input type=\"range\" min=\"0\" max=\"1000\" value=\"{}\"></label>",
                      name, value);
    }
  }
  return panel + "</div>";
}

}  // namespace

std::string viewer_html(const Model& model, const std::string& title, const ViewerLayers& layers,
                        int max_points) {
  TARSIER_REQUIRE(max_points >= 1, "{}", max_points);
  check(layers);
  const Frame frame{frame_model(model)};
  const Framing& framing = frame.framing;
  const double scale = framing.scale();
  nlohmann::json data = cloud_json(
      model.points.size(), frame, max_points,
      [&](std::size_t i) { return model.points[i].position; },
      [&](std::size_t i) { return model.points[i].color; });
  const bool has_cloud = !layers.cloud.positions.empty();
  const bool has_surface = !layers.surface.indices.empty();
  if (has_cloud) {
    data["cloud"] = cloud_json(
        layers.cloud.positions.size(), frame, kMaxCloudPoints,
        [&](std::size_t i) { return Eigen::Vector3d(layers.cloud.positions[i].cast<double>()); },
        [&](std::size_t i) { return layers.cloud.colors[i]; });
  }
  if (has_surface) data["mesh"] = surface_json(layers.surface, frame);
  const auto drawn_points = data["drawn"].get<std::size_t>();
  std::vector<float> cameras;
  nlohmann::json names = nlohmann::json::array();
  for (const Pyramid& pyramid : camera_pyramids(model, framing)) {
    for (const Eigen::Vector3d& vertex : pyramid.vertices) {
      const Eigen::Vector3d framed = frame.of(vertex);
      for (int k = 0; k < 3; ++k) cameras.push_back(static_cast<float>(framed[k]));
    }
    names.push_back(model.images[static_cast<std::size_t>(pyramid.image)].name);
  }

  const std::string points = counted(model.points.size(), "point", "points");
  const auto drawn = [&](std::size_t number) {
    return number == model.points.size() ? points
                                         : fmt::format("{}, {} drawn", points, grouped(number));
  };
  const std::size_t registered = names.size();
  std::string images = counted(registered, "image", "images");
  if (registered != model.images.size())
    images = fmt::format("{} of {}", grouped(registered),
                         counted(model.images.size(), "image", "images"));
  std::string more;
  if (has_cloud)
    more += " \u00b7 " + counted(layers.cloud.positions.size(), "dense point", "dense points");
  if (has_surface) more += " \u00b7 " + counted(layers.surface.indices.size() / 3, "face", "faces");
  data.update({
      {"radius", framing.radius / scale},
      {"height", framing.half_height / scale},
      {"unit", scale},  // units of the model per unit of the page
      {"cameras", base64_of(cameras)},
      {"names", std::move(names)},
      {"listed", std::min<std::size_t>(registered, 2000)},
      {"plainly", drawn(std::min<std::size_t>(drawn_points, 15000))},
  });

  const std::string label = escaped_markup(title);
  std::string page =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n<title>";
  page += label;
  page += "</title>\n<style>body{margin:0}</style></head><body>\n<div class=\"tv\"><style>";
  page += kViewerCss;
  page += "</style>\n<canvas tabindex=\"0\" aria-label=\"" + label + "\"></canvas>\n";
  page += "<svg class=\"tv-over\" aria-hidden=\"true\"></svg>\n";
  page += "<div class=\"tv-cams\"><div class=\"tv-bar\">";
  if (has_cloud || has_surface) page += layer_button("points", "Points");
  if (has_cloud) page += layer_button("cloud", "Dense");
  if (has_surface) page += layer_button("mesh", "Surface");
  page +=
      "<button type=\"button\" class=\"tv-measure\" aria-pressed=\"false\">Measure</button>"
      "<button type=\"button\" class=\"tv-slice\" aria-pressed=\"false\">Cut</button>"
      "<button type=\"button\" class=\"tv-list\" aria-pressed=\"false\">Names</button>"
      "<button type=\"button\" class=\"tv-show\" aria-pressed=\"true\">Cameras</button>"
      "<button type=\"button\" class=\"tv-reset\">Reset</button></div>";
  page += clipping_panel();
  page += "<output class=\"tv-length\" hidden></output><ol hidden></ol></div>\n";
  page +=
      "<div class=\"tv-legend\"><b>" + label +
      "</b><span><span class=\"tv-drawn\" "
      "style=\"display:inline\">" +
      drawn(drawn_points) + "</span> \u00b7 " + images + more +
      "</span>\n<span class=\"tv-keys\">drag: rotate \u00b7 wheel: zoom \u00b7 shift-drag: move "
      "\u00b7 double click: reset</span><noscript><span>Needs JavaScript.</span></noscript>"
      "</div>\n<div class=\"tv-tip\" hidden></div>\n";
  page += "<script type=\"application/json\" class=\"tv-data\">";
  page += json_in_script(data);
  page += "</script>\n<script>";
  page += kViewerJs;
  page += "</script></div>\n</body></html>\n";
  return page;
}

std::string viewer_html(const Model& model, const std::string& title, int max_points) {
  return viewer_html(model, title, {}, max_points);
}

}  // namespace tarsier::sfm
