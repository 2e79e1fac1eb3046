// SPDX-License-Identifier: MIT
#include "live_protocol.h"

#include "tarsier/core/require.h"

#include "router.h"
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

namespace tarsier::web {
namespace {

void put_u32(std::string& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8)
    out += static_cast<char>(value >> static_cast<unsigned>(shift));
}

// A finite number within the limits, or nullopt.
std::optional<double> number_in(const nlohmann::json& value, double low, double high) {
  if (!value.is_number()) return std::nullopt;
  const double number = value.get<double>();
  return std::isfinite(number) && number >= low && number <= high ? std::optional(number)
                                                                  : std::nullopt;
}

bool is_plain_name(const nlohmann::json& value) {
  if (!value.is_string()) return false;
  const auto& text = value.get_ref<const std::string&>();
  return !text.empty() && text.size() <= 100 && std::none_of(text.begin(), text.end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20;
  });
}

}  // namespace

std::uint32_t read_u32(const char* bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < 4; ++i) value = value << 8U | static_cast<unsigned char>(bytes[i]);
  return value;
}

bool WindowRecords::feed(std::string_view bytes) {
  if (broken_) return false;
  if (read_ > 0 && read_ == pending_.size()) {
    pending_.clear();
    read_ = 0;
  } else if (read_ > (1U << 20U)) {
    pending_.erase(0, read_);
    read_ = 0;
  }
  pending_ += bytes;
  return !broken_;
}

std::optional<WindowRecords::Record> WindowRecords::take() {
  if (broken_ || pending_.size() - read_ < 4) return std::nullopt;
  const std::uint32_t length = read_u32(pending_.data() + read_);
  if (length == 0 || length > kMaxRecord) {
    broken_ = true;
    pending_.clear();
    read_ = 0;
    return std::nullopt;
  }
  if (pending_.size() - read_ - 4 < length) return std::nullopt;
  Record record;
  record.kind = pending_[read_ + 4];
  record.payload = pending_.substr(read_ + 5, length - 1);
  read_ += 4 + length;
  return record;
}

std::optional<std::string> event_line(const nlohmann::json& event) {
  if (!event.is_object()) return std::nullopt;
  nlohmann::json line = nlohmann::json::object();
  for (const char* name : {"shift", "control"}) {
    const auto found = event.find(name);
    if (found == event.end()) continue;
    if (!found->is_boolean()) return std::nullopt;
    line[name] = *found;
  }
  if (const auto key = event.find("key"); key != event.end()) {
    const auto value = number_in(*key, 1, 0x1ffff);
    if (!value || !key->is_number_integer()) return std::nullopt;
    line["key"] = *key;
  } else if (const auto mouse = event.find("mouse"); mouse != event.end()) {
    static const std::vector<std::string> kKinds = {"move",        "left-down", "left-up",
                                                    "right-down",  "right-up",  "wheel",
                                                    "middle-down", "middle-up", "double"};
    if (!mouse->is_string() ||
        std::find(kKinds.begin(), kKinds.end(), mouse->get<std::string>()) == kKinds.end())
      return std::nullopt;
    line["mouse"] = *mouse;
    for (const char* name : {"x", "y", "wheel"}) {
      const auto found = event.find(name);
      if (found == event.end()) {
        if (*name != 'w') return std::nullopt;
        continue;
      }
      const bool is_notches = *name == 'w';
      if (!number_in(*found, is_notches ? -100 : -100'000, is_notches ? 100 : 100'000) ||
          (is_notches && !found->is_number_integer()))
        return std::nullopt;
      line[name] = *found;
    }
    // Refers to the image that was clicked on: another size may be in transit.
    if (const auto width = event.find("width"); width != event.end()) {
      if (!width->is_number_integer() || !number_in(*width, 1, 16384)) return std::nullopt;
      line["width"] = *width;
    }
  } else if (const auto action = event.find("action"); action != event.end()) {
    if (!is_plain_name(*action)) return std::nullopt;
    line = {{"action", *action}};
  } else if (const auto slider = event.find("slider"); slider != event.end()) {
    const auto value = event.find("value");
    if (!is_plain_name(*slider) || value == event.end() || !number_in(*value, -1e9, 1e9))
      return std::nullopt;
    line = {{"slider", *slider}, {"value", *value}};
  } else {
    return std::nullopt;
  }
  return to_text(line) + "\n";
}

std::string image_head(std::uint32_t frame, std::uint32_t age_ms) {
  std::string head;
  put_u32(head, frame);
  put_u32(head, age_ms);
  return head;
}

void append_record(std::string& out, LiveRecord kind, std::string_view id,
                   std::string_view payload) {
  TARSIER_REQUIRE(id.size() <= 255 && payload.size() <= (1U << 30U), "a record of {} bytes",
                  payload.size());
  put_u32(out, static_cast<std::uint32_t>(2 + id.size() + payload.size()));
  out += static_cast<char>(kind);
  out += static_cast<char>(id.size());
  out += id;
  out += payload;
}

}  // namespace tarsier::web
