// SPDX-License-Identifier: MIT
#include "ui/window_lines.h"

#include "tarsier/core/words.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace tarsier {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxNameLength = 200;
constexpr double kMaxCoordinate = 1e6;  // px
constexpr double kMaxValue = 1e12;
constexpr int kMaxNotches = 100;

constexpr std::array<std::pair<std::string_view, Event::Mouse>, 9> kMouse = {
    {{"move", Event::Mouse::kMove},
     {"left-down", Event::Mouse::kLeftDown},
     {"left-up", Event::Mouse::kLeftUp},
     {"right-down", Event::Mouse::kRightDown},
     {"right-up", Event::Mouse::kRightUp},
     {"middle-down", Event::Mouse::kMiddleDown},
     {"middle-up", Event::Mouse::kMiddleUp},
     {"wheel", Event::Mouse::kWheel},
     {"double", Event::Mouse::kDouble}}};

template <typename... Args>
void require(bool holds, fmt::format_string<Args...> reason, Args&&... args) {
  if (!holds) throw std::invalid_argument(fmt::format(reason, std::forward<Args>(args)...));
}

double number(const json& object, const char* name, double limit) {
  const auto found = object.find(name);
  require(found != object.end() && found->is_number(), "'{}': expected a number", name);
  const double value = found->get<double>();
  require(std::isfinite(value) && std::abs(value) <= limit, "'{}' is beyond {}", name, limit);
  return value;
}

int whole_number(const json& object, const char* name, int low, int high) {
  const double value = number(object, name, 1e9);
  require(value == std::floor(value) && value >= low && value <= high,
          "'{}': expected a whole number {}..{}", name, low, high);
  return static_cast<int>(value);
}

std::string name_in(const json& object, const char* name) {
  const json& value = object.at(name);
  require(value.is_string(), "'{}': expected a text", name);
  auto text = value.get<std::string>();
  require(!text.empty() && text.size() <= kMaxNameLength, "'{}' is empty or too long", name);
  return text;
}

bool is_on(const json& object, const char* name) {
  const auto found = object.find(name);
  if (found == object.end()) return false;
  require(found->is_boolean(), "'{}' is neither true nor false", name);
  return found->get<bool>();
}

std::optional<Event> event_in(const json& object) {
  Event event;
  const bool is_key = object.contains("key");
  const bool is_mouse = object.contains("mouse");
  const bool is_action = object.contains("action");
  const bool is_slider = object.contains("slider");
  const int kinds = int{is_key} + int{is_mouse} + int{is_action} + int{is_slider};
  if (kinds == 0) return std::nullopt;
  require(kinds == 1, "several events in one line");
  if (is_key) {
    event.kind = Event::Kind::kKey;
    event.key = whole_number(object, "key", 1, 0x1ffff);
  } else if (is_mouse) {
    const std::string what = name_in(object, "mouse");
    const auto* known = std::find_if(kMouse.begin(), kMouse.end(),
                                     [&](const auto& item) { return item.first == what; });
    require(known != kMouse.end(), "'mouse' does not do this");
    event.kind = Event::Kind::kMouse;
    event.mouse = known->second;
    event.x = number(object, "x", kMaxCoordinate);
    event.y = number(object, "y", kMaxCoordinate);
    if (object.contains("wheel"))
      event.wheel = whole_number(object, "wheel", -kMaxNotches, kMaxNotches);
  } else if (is_action) {
    event.kind = Event::Kind::kAction;
    event.name = name_in(object, "action");
  } else {
    event.kind = Event::Kind::kSlider;
    event.name = name_in(object, "slider");
    event.value = number(object, "value", kMaxValue);
  }
  event.shift = is_on(object, "shift");
  event.control = is_on(object, "control");
  return event;
}

}  // namespace

WindowLine parse_window_line(std::string_view line) {
  const json object = json::parse(line, nullptr, false);
  require(object.is_object(), "expected a JSON object");
  WindowLine result;
  result.event = event_in(object);
  if (result.event && result.event->kind == Event::Kind::kMouse && object.contains("width"))
    result.image_width = whole_number(object, "width", 1, 16384);
  if (object.contains("stages")) result.stages = whole_number(object, "stages", 0, 1'000'000) > 0;
  if (object.contains("want")) result.want = whole_number(object, "want", 0, 1'000'000) > 0;
  if (object.contains("quality")) result.quality = whole_number(object, "quality", 1, 100);
  if (object.contains("max_width")) {
    const int width = whole_number(object, "max_width", 0, 16384);
    require(width == 0 || width >= 16, "'max_width' is below 16");
    result.max_width = width;
  }
  result.close = is_on(object, "close");
  const bool is_known = result.event || result.want || result.stages || result.quality ||
                        result.max_width || object.contains("close");
  require(is_known, "neither an event nor a request");
  return result;
}

void WindowLines::refuse(std::string reason) {
  ++refused_;
  last_error_ = std::move(reason);
}

std::vector<WindowLine> WindowLines::feed(std::string_view bytes) {
  std::vector<WindowLine> lines;
  while (!bytes.empty()) {
    const std::size_t end = bytes.find('\n');
    const std::string_view part = bytes.substr(0, end);
    bytes.remove_prefix(end == std::string_view::npos ? bytes.size() : end + 1);
    if (!skipping_ && line_.size() + part.size() > kMaxLineLength) {
      skipping_ = true;
      line_ = {};
      refuse("the line is longer than 64 kB");
    }
    if (!skipping_) line_ += part;
    if (end == std::string_view::npos) break;
    if (!skipping_ && !trimmed(line_).empty()) {
      try {
        lines.push_back(parse_window_line(line_));
      } catch (const std::invalid_argument& error) {
        refuse(error.what());
      }
    }
    skipping_ = false;
    line_.clear();
  }
  return lines;
}

}  // namespace tarsier
