// SPDX-License-Identifier: MIT
#include "viewer.h"

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
#include <string_view>
#include <vector>

namespace tarsier::sfm {
namespace {

static_assert(std::endian::native == std::endian::little, "the page reads little endian numbers");

constexpr double kWidest = 8;  // scales from the middle; positions have 16 bits for all of it

// JSON that may stand within a script element: nothing in it can end that element.
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

std::string base64(const void* data, std::size_t size) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const auto* bytes = static_cast<const std::uint8_t*>(data);
  std::string result;
  result.reserve((size + 2) / 3 * 4);
  for (std::size_t i = 0; i < size; i += 3) {
    const std::size_t have = std::min<std::size_t>(3, size - i);
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 3; ++k) word = word << 8 | (k < have ? bytes[i + k] : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      result += k <= have ? kDigits[word >> (18 - 6 * k) & 63U] : '=';
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

std::string viewer(const Model& model, const std::string& title, int max_points, bool whole) {
  TARSIER_REQUIRE(max_points >= 1, "{}", max_points);
  const Framing framing = frame_model(model);
  const double scale = framing.scale();

  std::vector<std::size_t> order;
  double range = 1;
  for (std::size_t i = 0; i < model.points.size(); ++i) {
    const Eigen::Vector3d framed = framing.framed(model.points[i].position) / scale;
    const double widest = framed.cwiseAbs().maxCoeff();
    if (!(widest <= kWidest) || !framed.allFinite()) continue;
    range = std::max(range, widest);
    order.push_back(i);
  }
  // Shuffled, so that the first so many are spread evenly: the page draws fewer without WebGL.
  Rng random(1);
  for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random() % i]);
  if (order.size() > static_cast<std::size_t>(max_points))
    order.resize(static_cast<std::size_t>(max_points));

  std::vector<std::uint16_t> positions;
  std::vector<std::uint8_t> colors;
  for (const std::size_t i : order) {
    const Point& point = model.points[i];
    const Eigen::Vector3d framed = framing.framed(point.position) / scale;
    for (int k = 0; k < 3; ++k) {
      positions.push_back(
          static_cast<std::uint16_t>(std::lround((framed[k] / range + 1) * 32767.5)));
      colors.push_back(point.color[2 - k]);
    }
  }
  std::vector<float> cameras;
  nlohmann::json names = nlohmann::json::array();
  for (const Pyramid& pyramid : camera_pyramids(model, framing)) {
    for (const Eigen::Vector3d& vertex : pyramid.vertices) {
      const Eigen::Vector3d framed = framing.framed(vertex) / scale;
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
  nlohmann::json data = {
      {"drawn", order.size()},
      {"range", range},
      {"radius", framing.radius / scale},
      {"height", framing.half_height / scale},
      {"positions", base64(positions.data(), positions.size() * sizeof(positions[0]))},
      {"colors", base64(colors.data(), colors.size())},
      {"cameras", base64(cameras.data(), cameras.size() * sizeof(float))},
      {"names", std::move(names)},
      {"listed", std::min<std::size_t>(registered, 2000)},
      {"plainly", drawn(std::min<std::size_t>(order.size(), 15000))},
  };

  std::string page;
  const std::string label = escaped_markup(title);
  if (whole) {
    page +=
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
        "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n<title>";
    page += label;
    page += "</title>\n<style>body{margin:0}</style></head><body>\n";
  }
  page += whole ? "<div class=\"tv\">" : "<div class=\"tv tv-part\">";
  page += "<style>";
  page += kViewerCss;
  // After the general height of a view.
  if (whole) page += "body>.tv{height:100vh;min-height:0}\n";
  page += "</style>\n<canvas tabindex=\"0\" aria-label=\"" + label + "\"></canvas>\n";
  page +=
      "<div class=\"tv-cams\"><div class=\"tv-bar\">"
      "<button type=\"button\" class=\"tv-list\" aria-pressed=\"false\">Names</button>"
      "<button type=\"button\" class=\"tv-show\" aria-pressed=\"true\">Cameras</button>"
      "<button type=\"button\" class=\"tv-reset\">Reset</button></div><ol hidden></ol></div>\n";
  page += "<div class=\"tv-legend\"><b>" + label +
          "</b><span><span class=\"tv-drawn\" "
          "style=\"display:inline\">" +
          drawn(order.size()) + "</span> \u00b7 " + images +
          "</span>\n<span class=\"tv-keys\">drag: turn \u00b7 wheel: zoom \u00b7 shift-drag: move "
          "\u00b7 double click: reset</span><noscript><span>Needs JavaScript.</span></noscript>"
          "</div>\n<div class=\"tv-tip\" hidden></div>\n";
  page += "<script type=\"application/json\" class=\"tv-data\">";
  page += json_in_script(data);
  page += "</script>\n<script>";
  page += kViewerJs;
  page += "</script></div>\n";
  if (whole) page += "</body></html>\n";
  return page;
}

}  // namespace

std::string viewer_html(const Model& model, const std::string& title, int max_points) {
  return viewer(model, title, max_points, true);
}

std::string viewer_fragment(const Model& model, const std::string& title, int max_points) {
  return viewer(model, title, max_points, false);
}

}  // namespace tarsier::sfm
