// SPDX-License-Identifier: MIT
#include "pipe_window.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgproc.hpp>

#include "ui/window_lines.h"
#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <fcntl.h>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace tarsier::window {
namespace {

using Clock = std::chrono::steady_clock;
using nlohmann::ordered_json;
using std::chrono::milliseconds;

constexpr int kDefaultQuality = 80;
constexpr int kMaxSide = 16384;     // px, of images that are sent
constexpr int kMaxStageSide = 480;  // px, of stages
constexpr std::size_t kMaxStages = 32;
constexpr int kPipeBytes = 1 << 20;         // requested from the system: most images fit at once
constexpr milliseconds kCloseTimeout{200};  // for the last state, when the window is closed
constexpr std::chrono::seconds kWarningInterval{1};  // between two warnings
constexpr std::size_t kMaxReadBytes = 64U
                                      << 10U;  // per read, so that a flood cannot delay the frames

// --- records ---

void put_u32(std::vector<std::uint8_t>& to, std::size_t value) {
  for (const unsigned shift : {24U, 16U, 8U, 0U})
    to.push_back(static_cast<std::uint8_t>(value >> shift & 0xffU));
}

std::vector<std::uint8_t> record(char kind, const ordered_json& json) {
  // File names may contain any bytes.
  const std::string text = json.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
  std::vector<std::uint8_t> bytes;
  bytes.reserve(text.size() + 5);
  put_u32(bytes, text.size() + 1);
  bytes.push_back(static_cast<std::uint8_t>(kind));
  bytes.insert(bytes.end(), text.begin(), text.end());
  return bytes;
}

ordered_json hello_json(const std::string& title, const std::vector<Action>& actions,
                        const std::vector<Slider>& sliders, bool stages) {
  ordered_json json{{"title", title},
                    {"actions", ordered_json::array()},
                    {"sliders", ordered_json::array()},
                    {"stages", stages}};
  for (const Action& action : actions)
    json["actions"].push_back({{"name", action.name}, {"help", action.help}, {"key", action.key}});
  for (const Slider& slider : sliders) {
    json["sliders"].push_back({{"name", slider.name},
                               {"low", slider.low},
                               {"high", slider.high},
                               {"step", slider.step},
                               {"value", slider.value}});
  }
  return json;
}

bool have_same_definitions(const std::vector<Action>& a, const std::vector<Action>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Action& x, const Action& y) {
    return x.name == y.name && x.help == y.help && x.key == y.key;
  });
}

// Equal except for the values.
bool have_same_definitions(const std::vector<Slider>& a, const std::vector<Slider>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Slider& x, const Slider& y) {
    return x.name == y.name && x.low == y.low && x.high == y.high && x.step == y.step;
  });
}

std::uint32_t milliseconds_since(const std::optional<Clock::time_point>& then) {
  if (!then) return 0;
  const auto age = std::chrono::duration_cast<milliseconds>(Clock::now() - *then).count();
  return static_cast<std::uint32_t>(
      std::clamp<std::int64_t>(age, 0, std::numeric_limits<std::uint32_t>::max()));
}

bool is_move(const Event& event) {
  return event.kind == Event::Kind::kMouse && event.mouse == Event::Mouse::kMove;
}

// --- the window ---

class PipeWindow final : public Window {
 public:
  PipeWindow(const PipeEnds& ends, const WindowOptions& options)
      : ends_(ends),
        title_(options.title),
        has_stages_(options.stages),
        actions_(options.actions),
        sliders_(options.sliders),
        fullscreen_(options.fullscreen) {
    for (const int fd : {ends_.in, ends_.out}) {
      ::fcntl(fd, F_SETFD, FD_CLOEXEC);
      ::fcntl(fd, F_SETFL, ::fcntl(fd, F_GETFL) | O_NONBLOCK);
    }
    struct stat what {};
    is_socket_ = ::fstat(ends_.out, &what) == 0 && S_ISSOCK(what.st_mode);
    if (!is_socket_) ::fcntl(ends_.out, F_SETPIPE_SZ, kPipeBytes);  // a smaller one works, too
    hello_ = record('H', hello_json(title_, actions_, sliders_, has_stages_));
    advance();
  }

  ~PipeWindow() override {
    try {
      const Clock::time_point end = Clock::now() + kCloseTimeout;
      while (!closed_ && has_pending_output() && Clock::now() < end) wait(milliseconds(10));
    } catch (const std::exception&) {  // there is nobody to report it to
    }
    ::close(ends_.in);
    if (ends_.out != ends_.in) ::close(ends_.out);
  }

  PipeWindow(const PipeWindow&) = delete;
  PipeWindow& operator=(const PipeWindow&) = delete;

  void show(const View& view, const FrameInfo* frame) override {
    if (closed_) return;
    if (!view.image.empty()) {
      require_bgr(view.image);
      view.image.copyTo(image_);
      is_new_ = true;
      frame_number_ =
          frame != nullptr ? static_cast<std::uint32_t>(frame->index) : frame_number_ + 1;
      captured_ = frame != nullptr ? frame->captured : std::nullopt;
    }
    state_ = record('S', state_json(view, frame));
    advance();
  }

  std::vector<Event> poll(milliseconds timeout) override {
    const Clock::time_point deadline = Clock::now() + timeout;
    while (!closed_) {
      advance();
      read_lines();
      if (!events_.empty() || closed_) break;
      const auto left = std::chrono::ceil<milliseconds>(deadline - Clock::now());
      if (left <= milliseconds(0)) break;
      wait(left);
    }
    delivered_ = received_;
    return std::exchange(events_, {});
  }

  [[nodiscard]] bool closed() const override { return closed_; }
  void set_fullscreen(bool on) override { fullscreen_ = on; }
  [[nodiscard]] bool fullscreen() const override { return fullscreen_; }

  void set_controls(const std::vector<Action>& actions,
                    const std::vector<Slider>& sliders) override {
    const bool is_same =
        have_same_definitions(actions, actions_) && have_same_definitions(sliders, sliders_);
    actions_ = actions;
    sliders_ = sliders;
    if (is_same || closed_) return;
    hello_ = record('H', hello_json(title_, actions_, sliders_, has_stages_));
    advance();
  }

  [[nodiscard]] bool wants_stages() const override { return stages_requested_ && !closed_; }

  void show_stages(const std::vector<Stage>& stages) override {
    stages_.clear();
    for (const Stage& stage : stages) {
      if (stages_.size() == kMaxStages) break;
      if (stage.image.empty()) continue;
      const int side = std::max(stage.image.cols, stage.image.rows);
      Stage small{stage.name, {}};
      if (side > kMaxStageSide) {
        const double scale = static_cast<double>(kMaxStageSide) / side;
        cv::resize(stage.image, small.image,
                   {std::max(1, cvRound(stage.image.cols * scale)),
                    std::max(1, cvRound(stage.image.rows * scale))},
                   0, 0, cv::INTER_AREA);
      } else {
        small.image = stage.image.clone();
      }
      stages_.push_back(std::move(small));
    }
    advance();
  }

 private:
  // --- out ---

  [[nodiscard]] cv::Size size_to_send() const {
    if (image_.empty()) return {};
    double scale = 1;
    if (max_width_ > 0) scale = std::min(scale, static_cast<double>(max_width_) / image_.cols);
    scale = std::min(scale, static_cast<double>(kMaxSide) / std::max(image_.cols, image_.rows));
    if (scale >= 1) return image_.size();
    return {std::max(1, cvRound(image_.cols * scale)), std::max(1, cvRound(image_.rows * scale))};
  }

  [[nodiscard]] ordered_json state_json(const View& view, const FrameInfo* frame) const {
    const cv::Size size = size_to_send();
    ordered_json json{{"status", view.status},
                      {"state", view.state.is_null() ? nlohmann::json::object() : view.state},
                      {"frame", nullptr},
                      {"sliders", ordered_json::object()},
                      {"finished", view.finished},
                      {"fullscreen", fullscreen_},
                      {"width", size.width},
                      {"height", size.height},
                      {"events", delivered_}};
    if (frame != nullptr) {
      json["frame"] = {{"index", frame->index},   {"time", std::round(frame->time * 1e6) / 1e6},
                       {"name", frame->name},     {"age_ms", milliseconds_since(frame->captured)},
                       {"source", frame->source}, {"detail", frame->detail}};
    }
    for (const Slider& slider : sliders_) json["sliders"][slider.name] = slider.value;
    return json;
  }

  // The newest image as a record; empty if it cannot be encoded.
  std::vector<std::uint8_t> image_record() {
    const cv::Size size = size_to_send();
    const std::uint32_t age = milliseconds_since(captured_);
    std::vector<std::uint8_t> bytes;
    try {
      const bool is_scaled = size != image_.size();
      if (is_scaled) cv::resize(image_, scaled_, size, 0, 0, cv::INTER_AREA);
      const std::vector<std::uint8_t> jpeg =
          encode_image(".jpg", is_scaled ? scaled_ : image_, "the window's image", quality_);
      bytes.reserve(jpeg.size() + 13);
      put_u32(bytes, jpeg.size() + 9);
      bytes.push_back('J');
      put_u32(bytes, frame_number_);
      put_u32(bytes, age);
      bytes.insert(bytes.end(), jpeg.begin(), jpeg.end());
    } catch (const OutputError& error) {
      warn(error.what());
      return {};
    }
    sent_image_size_ = image_.size();
    sent_size_ = size;
    return bytes;
  }

  std::vector<std::uint8_t> stages_record() {
    ordered_json list = ordered_json::array();
    std::vector<std::uint8_t> images;
    for (const Stage& stage : stages_) {
      try {
        const std::vector<std::uint8_t> jpeg =
            encode_image(".jpg", stage.image, "a stage's image", kDefaultQuality);
        list.push_back({{"name", stage.name},
                        {"width", stage.image.cols},
                        {"height", stage.image.rows},
                        {"bytes", jpeg.size()}});
        images.insert(images.end(), jpeg.begin(), jpeg.end());
      } catch (const OutputError& error) {
        warn(error.what());
      }
    }
    const std::string text = list.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
    std::vector<std::uint8_t> bytes;
    bytes.reserve(text.size() + images.size() + 13);
    put_u32(bytes, text.size() + images.size() + 9);
    bytes.push_back('D');
    put_u32(bytes, frame_number_);
    put_u32(bytes, text.size());
    bytes.insert(bytes.end(), text.begin(), text.end());
    bytes.insert(bytes.end(), images.begin(), images.end());
    return bytes;
  }

  [[nodiscard]] bool are_stages_due() const { return stages_requested_ && !stages_.empty(); }
  [[nodiscard]] bool is_image_due() const { return image_requested_ && is_new_ && !image_.empty(); }
  [[nodiscard]] bool has_pending_output() const {
    return !writing_.empty() || !hello_.empty() || !state_.empty() || is_image_due() ||
           are_stages_due();
  }

  // Writes as much as the other side accepts now.
  void advance() {
    while (!closed_ && has_pending_output()) {
      if (writing_.empty()) {
        written_ = 0;
        if (!hello_.empty()) {
          writing_ = std::exchange(hello_, {});
        } else if (!state_.empty()) {
          writing_ = std::exchange(state_, {});
        } else if (are_stages_due()) {
          writing_ = stages_record();
          stages_requested_ = false;
          stages_.clear();
        } else {
          image_requested_ = is_new_ = false;
          writing_ = image_record();
          continue;
        }
      }
      if (!write_some()) return;
    }
  }

  // Returns false if the pipe is full, so that the rest must be sent later.
  bool write_some() {
    const std::uint8_t* from = writing_.data() + written_;
    const std::size_t left = writing_.size() - written_;
    // A closed reader raises no signal: the program ignores SIGPIPE (cli.cpp).
    const ssize_t count =
        is_socket_ ? ::send(ends_.out, from, left, MSG_NOSIGNAL) : ::write(ends_.out, from, left);
    if (count < 0 && errno == EINTR) return true;
    if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return false;
    if (count <= 0) {
      closed_ = true;
      return false;
    }
    written_ += static_cast<std::size_t>(count);
    if (written_ == writing_.size()) {
      writing_ = {};
      written_ = 0;
    }
    return true;
  }

  // --- in ---

  // Waits until there is input, or space for the pending record.
  void wait(milliseconds timeout) {
    std::array<pollfd, 2> items{
        {{ends_.in, POLLIN, 0},
         {ends_.out, static_cast<short>(has_pending_output() ? POLLOUT : 0), 0}}};
    if (::poll(items.data(), items.size(), static_cast<int>(timeout.count())) <= 0) return;
    if ((items[1].revents & (POLLERR | POLLNVAL)) != 0) closed_ = true;
    if ((items[1].revents & POLLOUT) != 0) advance();
  }

  void read_lines() {
    if (closed_) return;
    buffer_.resize(kMaxReadBytes);
    const ssize_t count = ::read(ends_.in, buffer_.data(), buffer_.size());
    if (count < 0 && (errno == EINTR || errno == EAGAIN || errno == EWOULDBLOCK)) return;
    if (count <= 0) {
      closed_ = true;
      return;
    }
    const std::size_t refused = lines_.refused();
    for (WindowLine& line :
         lines_.feed(std::string_view(buffer_.data(), static_cast<std::size_t>(count))))
      take(line);
    received_ += lines_.refused() - refused;
    if (lines_.refused() != refused) warn("a line is ignored: " + lines_.last_error());
    // An image requested together with an event must show the event's effect.
    if (events_.empty()) advance();
  }

  void take(WindowLine& line) {
    if (line.close) closed_ = true;
    if (line.want) image_requested_ = *line.want;
    if (line.stages) stages_requested_ = *line.stages && has_stages_;
    const bool changes = (line.quality && *line.quality != quality_) ||
                         (line.max_width && *line.max_width != max_width_);
    quality_ = line.quality.value_or(quality_);
    max_width_ = line.max_width.value_or(max_width_);
    if (changes) is_new_ = true;  // the same image must be sent again
    if (!line.event) return;
    ++received_;
    Event& event = *line.event;
    if (event.kind == Event::Kind::kMouse) {
      // If no image was requested yet, the size of the one that would be sent.
      cv::Size from = sent_size_.empty() ? size_to_send() : sent_size_;
      const cv::Size to = sent_size_.empty() ? image_.size() : sent_image_size_;
      if (line.image_width && !from.empty()) {
        const double ratio = static_cast<double>(*line.image_width) / to.width;
        from = {*line.image_width, std::max(1, cvRound(to.height * ratio))};
      }
      if (from.empty()) return;
      event.x = (event.x + 0.5) * to.width / from.width - 0.5;
      event.y = (event.y + 0.5) * to.height / from.height - 0.5;
    } else if (event.kind == Event::Kind::kAction) {
      const bool is_known = std::any_of(actions_.begin(), actions_.end(),
                                        [&](const Action& a) { return a.name == event.name; });
      if (!is_known) return warn(fmt::format("unknown action '{}'", event.name));
    } else if (event.kind == Event::Kind::kSlider) {
      const auto slider = std::find_if(sliders_.begin(), sliders_.end(),
                                       [&](const Slider& s) { return s.name == event.name; });
      if (slider == sliders_.end()) return warn(fmt::format("unknown slider '{}'", event.name));
      event.value = std::clamp(event.value, slider->low, slider->high);
    }
    // A mouse sends hundreds of moves per second; only the latest position matters.
    if (is_move(event) && !events_.empty() && is_move(events_.back())) {
      events_.back() = event;
    } else {
      events_.push_back(std::move(event));
    }
  }

  void warn(const std::string& warning) {
    const Clock::time_point now = Clock::now();
    if (warned_ && now - *warned_ < kWarningInterval) return;
    warned_ = now;
    log_warning("window: {}", warning);
  }

  const PipeEnds ends_;
  const std::string title_;
  const bool has_stages_;
  bool is_socket_ = false;
  bool closed_ = false;

  // The offered actions and sliders.
  std::vector<Action> actions_;
  std::vector<Slider> sliders_;
  bool fullscreen_;

  // Output: the record being sent, and the pending data.
  std::vector<std::uint8_t> writing_;
  std::size_t written_ = 0;
  std::vector<std::uint8_t> hello_;
  std::vector<std::uint8_t> state_;
  cv::Mat image_;  // the newest
  cv::Mat scaled_;
  bool is_new_ = false;  // and not sent yet
  bool image_requested_ = false;
  std::vector<Stage> stages_;  // of the newest frame, not sent yet
  bool stages_requested_ = false;
  std::uint32_t frame_number_ = 0;
  std::optional<Clock::time_point> captured_;
  int quality_ = kDefaultQuality;
  int max_width_ = 0;

  // Input.
  WindowLines lines_;
  std::vector<char> buffer_;
  std::vector<Event> events_;
  std::uint64_t received_ = 0;  // events and skipped lines
  // number of them that the session got; the next view includes their effect
  std::uint64_t delivered_ = 0;
  cv::Size sent_image_size_;  // size of the last sent image
  cv::Size sent_size_;        // the size in which it was sent
  std::optional<Clock::time_point> warned_;
};

}  // namespace

PipeEnds parse_pipe_ends(std::string_view text) {
  const auto fail = [&](std::string_view reason) -> PipeEnds {
    throw Error(ErrorKind::kInput, fmt::format("{}={}: {}", kPipeVariable, text, reason));
  };
  std::string_view rest = text;
  if (!rest.starts_with("pipe:")) return fail("expected pipe:IN:OUT");
  rest.remove_prefix(5);
  const std::size_t colon = rest.find(':');
  if (colon == std::string_view::npos) return fail("expected pipe:IN:OUT");
  const auto in = to_integer(rest.substr(0, colon), 3, 65535);
  const auto out = to_integer(rest.substr(colon + 1), 3, 65535);
  if (!in || !out) return fail("expected the numbers of two descriptors, 3 or more");
  const PipeEnds ends{static_cast<int>(*in), static_cast<int>(*out)};
  for (const int fd : {ends.in, ends.out}) {
    if (::fcntl(fd, F_GETFD) < 0) return fail(fmt::format("descriptor {} is not open", fd));
  }
  return ends;
}

std::unique_ptr<Window> make_pipe_window(const PipeEnds& ends, const WindowOptions& options) {
  return std::make_unique<PipeWindow>(ends, options);
}

}  // namespace tarsier::window
