// SPDX-License-Identifier: MIT
#include "ui/action_reader.h"

#include "tarsier/core/log.h"
#include "tarsier/core/words.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <poll.h>
#include <unistd.h>
#include <utility>

namespace tarsier {
namespace {

constexpr std::size_t kMaxLineLength = 200;

}  // namespace

ActionReader::ActionReader(int fd, std::vector<Action> actions, std::vector<Slider> sliders)
    : fd_(fd), actions_(std::move(actions)), sliders_(std::move(sliders)) {}

void ActionReader::take_line(std::string_view line, std::vector<Event>& events) const {
  line = trimmed(line);
  if (line.empty() || line.front() == '#') return;
  const std::size_t space = line.find_first_of(" \t");
  const std::string_view name = line.substr(0, space);
  const std::string_view rest = space == std::string_view::npos ? "" : trimmed(line.substr(space));

  const auto slider = std::find_if(sliders_.begin(), sliders_.end(),
                                   [&](const Slider& s) { return s.name == name; });
  if (slider != sliders_.end() && !rest.empty()) {
    double value = 0;
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
    if (error != std::errc() || end != rest.data() + rest.size() || !std::isfinite(value)) {
      log_warning("action '{}': expected a number, got '{}'", name, rest);
      return;
    }
    events.push_back(slider_event(slider->name, std::clamp(value, slider->low, slider->high)));
    return;
  }
  const auto action = std::find_if(actions_.begin(), actions_.end(),
                                   [&](const Action& a) { return a.name == name; });
  if (action != actions_.end()) {
    if (!rest.empty()) {
      log_warning("action '{}' takes no value, got '{}'", name, rest);
      return;
    }
    events.push_back(action_event(action->name));
    return;
  }
  if (slider != sliders_.end()) {
    log_warning("action '{}' needs a number {}..{}", name, slider->low, slider->high);
    return;
  }
  std::string known;
  for (const Action& a : actions_) known += (known.empty() ? "" : ", ") + a.name;
  for (const Slider& s : sliders_) known += (known.empty() ? "" : ", ") + s.name + " NUMBER";
  log_warning("unknown action '{}'; known are: {}", name, known);
}

std::vector<Event> ActionReader::read() {
  std::vector<Event> events;
  if (ended_) return events;
  struct ::pollfd ready {
    fd_, POLLIN, 0
  };
  if (::poll(&ready, 1, 0) <= 0) return events;
  std::array<char, 4096> buffer;
  const ssize_t got =
      (ready.revents & POLLNVAL) != 0 ? 0 : ::read(fd_, buffer.data(), buffer.size());
  if (got < 0 && (errno == EINTR || errno == EAGAIN || errno == EWOULDBLOCK)) return events;
  if (got <= 0) {
    ended_ = true;
    if (!skipping_) take_line(line_, events);
    line_.clear();
    return events;
  }
  for (const char c : std::string_view(buffer.data(), static_cast<std::size_t>(got))) {
    if (c == '\n') {
      if (!skipping_) take_line(line_, events);
      line_.clear();
      skipping_ = false;
    } else if (!skipping_) {
      line_ += c;
      if (line_.size() > kMaxLineLength) {
        log_warning("action '{}..': the line is longer than {} bytes", line_.substr(0, 20),
                    kMaxLineLength);
        line_.clear();
        skipping_ = true;
      }
    }
  }
  return events;
}

}  // namespace tarsier
