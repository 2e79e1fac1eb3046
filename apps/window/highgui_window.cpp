// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"

#include <fmt/format.h>
#include <opencv2/core/version.hpp>
#include <opencv2/highgui.hpp>

#include "framework/exit_status.h"
#include "letterbox.h"
#include "module.h"
#include "x11_window.h"
#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <sys/socket.h>
#include <sys/un.h>
#include <thread>
#include <unistd.h>

namespace tarsier::window {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

[[noreturn]] void fail(const std::string& message) { throw Error(ErrorKind::kInput, message); }

[[noreturn]] void fail_display_lost() { fail("the display was lost; the window is closed"); }

// --- a toolkit that ends the process ---

// Qt aborts if it finds no display, and calls exit(1) if it loses one. Both cases are checked
// before each call. If one occurs during a call, these two functions at least print one line and
// set the right exit status.

volatile std::sig_atomic_t g_is_in_toolkit = 0;

void exit_with_line(const char* line) {
  [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, line, std::strlen(line));
  _exit(static_cast<int>(ExitStatus::kBadInput));
}

void on_abort(int) {
  exit_with_line("tarsier: error: no display: the window toolkit cannot use it; give -o OUT\n");
}

void on_exit() {
  if (g_is_in_toolkit != 0)
    exit_with_line("tarsier: error: the display was lost; the window is closed\n");
}

class ToolkitGuard {
 public:
  ToolkitGuard() : before_(g_is_in_toolkit) { g_is_in_toolkit = 1; }
  ~ToolkitGuard() { g_is_in_toolkit = before_; }
  ToolkitGuard(const ToolkitGuard&) = delete;
  ToolkitGuard& operator=(const ToolkitGuard&) = delete;

 private:
  std::sig_atomic_t before_;
};

class AbortHandler {
 public:
  AbortHandler() {
    struct sigaction action {};
    action.sa_handler = on_abort;
    sigaction(SIGABRT, &action, &before_);
  }
  ~AbortHandler() { sigaction(SIGABRT, &before_, nullptr); }
  AbortHandler(const AbortHandler&) = delete;
  AbortHandler& operator=(const AbortHandler&) = delete;

 private:
  struct sigaction before_ {};
};

bool wayland_responds() {
  const char* display = std::getenv("WAYLAND_DISPLAY");
  const char* folder = std::getenv("XDG_RUNTIME_DIR");
  if (display == nullptr || *display == '\0') return false;
  const std::string path = *display == '/' || folder == nullptr
                               ? std::string(display)
                               : std::string(folder) + '/' + display;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path) return false;
  std::copy(path.begin(), path.end(), address.sun_path);
  const int socket_fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (socket_fd < 0) return false;
  const bool connected =
      connect(socket_fd, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  close(socket_fd);
  return connected;
}

// The connection of check_display(), kept for the first window. An X server without a session
// (Xvfb, a kiosk) resets when its last client disconnects, which must not happen between the check
// and the window.
std::unique_ptr<X11Window>& checked_connection() {
  static std::unique_ptr<X11Window> connection;
  return connection;
}

std::unique_ptr<X11Window> take_connection() {
  std::unique_ptr<X11Window> connection = std::move(checked_connection());
  return connection != nullptr ? std::move(connection) : X11Window::connect();
}

void check_display() {
  checked_connection() = X11Window::connect();
  if (checked_connection() != nullptr) {
    // Through X even on a Wayland desktop, because X11Window handles the pointer and the keys.
    setenv("QT_QPA_PLATFORM", "xcb", 1);
    setenv("GDK_BACKEND", "x11", 1);
  } else if (wayland_responds()) {
    setenv("QT_QPA_PLATFORM", "wayland", 1);
  } else {
    const char* display = std::getenv("DISPLAY");
    fail(fmt::format("no display: no answer from {}; give -o OUT, or run on a desktop",
                     display != nullptr && *display != '\0' ? fmt::format("DISPLAY={}", display)
                                                            : std::string("WAYLAND_DISPLAY")));
  }
  setenv("QT_LOGGING_RULES", "*.debug=false;*.info=false;*.warning=false;qt.*=false", 0);
  unsetenv("SESSION_MANAGER");  // Qt complains on stderr if it does not answer
}

// --- the window ---

struct Trackbar {
  Slider slider;
  int position = 0;  // steps from slider.low
  [[nodiscard]] int steps() const {
    return std::max(1, static_cast<int>(std::lround((slider.high - slider.low) / slider.step)));
  }
  [[nodiscard]] int position_of(double value) const {
    return std::clamp(static_cast<int>(std::lround((value - slider.low) / slider.step)), 0,
                      steps());
  }
  [[nodiscard]] double value_at(int at) const {
    return std::min(slider.high, slider.low + at * slider.step);
  }
};

class HighguiWindow final : public Window {
 public:
  explicit HighguiWindow(const WindowOptions& options)
      : title_(options.title), fullscreen_(options.fullscreen), x11_(take_connection()) {
    for (const Slider& slider : options.sliders) {
      TARSIER_REQUIRE(slider.step > 0 && slider.high > slider.low, "slider '{}'", slider.name);
      Trackbar bar{slider, 0};
      bar.position = bar.position_of(slider.value);
      trackbars_.push_back(bar);
    }
  }

  ~HighguiWindow() override {
    try {
      if (!name_.empty() && is_alive()) destroy(name_);
    } catch (const std::exception&) {  // nothing left to close
    }
  }

  HighguiWindow(const HighguiWindow&) = delete;
  HighguiWindow& operator=(const HighguiWindow&) = delete;

  void show(const View& view, const FrameInfo*) override {
    const cv::Mat& image = view.image;
    if (image.empty() || closed_) return;
    require_bgr(image);
    const bool resized = image.size() != image_.size();
    image.copyTo(image_);
    if (name_.empty()) {
      create();
    } else if (resized && !fullscreen_ && view_size() == natural_size_) {
      set_natural_size();  // unless the user chose another size
    }
    draw();
  }

  std::vector<Event> poll(milliseconds timeout) override {
    const Clock::time_point deadline = Clock::now() + timeout;
    for (;;) {
      if (!name_.empty() && !closed_) pump();
      const auto left = std::chrono::ceil<milliseconds>(deadline - Clock::now());
      if (!events_.empty() || closed_ || left <= milliseconds(0)) break;
      const milliseconds slice =
          std::min(left, milliseconds(10));  // the toolkit must be called often
      if (x11_ != nullptr) {
        x11_->wait(slice);
      } else {
        std::this_thread::sleep_for(slice);
      }
    }
    std::vector<Event> result(events_.begin(), events_.end());
    events_.clear();
    return result;
  }

  [[nodiscard]] bool closed() const override { return closed_; }
  [[nodiscard]] bool fullscreen() const override { return fullscreen_; }

  void set_fullscreen(bool on) override {
    if (fullscreen_ == on) return;
    fullscreen_ = on;
    if (name_.empty() || closed_) return;
    // A new window, because sliders cannot be removed from a highgui window. It is opened before
    // the old one is closed, so that the desktop never sees the program without a window.
    const std::string old = name_;
    if (x11_ != nullptr) x11_->detach();
    create();
    draw();
    destroy(old);
  }

  void set_controls(const std::vector<Action>&, const std::vector<Slider>& sliders) override {
    for (const Slider& slider : sliders) set_slider(slider.name, slider.value);
  }

 private:
  void set_slider(const std::string& name, double value) {
    for (Trackbar& bar : trackbars_) {
      if (bar.slider.name != name) continue;
      const int position = bar.position_of(value);
      if (position == bar.position) continue;
      bar.position = position;
      if (has_trackbars_ && !closed_) {
        check_alive();
        const ToolkitGuard guard;
        cv::setTrackbarPos(bar.slider.name, name_, position);
      }
    }
  }

  [[nodiscard]] bool is_alive() const { return x11_ == nullptr || x11_->alive(); }
  void check_alive() const {
    if (!is_alive()) fail_display_lost();
  }

  void destroy(const std::string& name) {
    check_alive();
    const ToolkitGuard guard;
    cv::destroyWindow(name);
    cv::waitKeyEx(1);
  }

  // The area for images: the window without its sliders.
  [[nodiscard]] cv::Size view_size() const {
    check_alive();
    cv::Rect shown;
    {
      const ToolkitGuard guard;
      shown = cv::getWindowImageRect(name_);
    }
    if (shown.width <= 0 || shown.height <= 0) return image_.size();
#if CV_VERSION_MAJOR > 4 || (CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR > 6)
    // This toolkit reports the position of the image instead. An image smaller than the area is
    // centred.
    const std::optional<cv::Point> origin = x11_ != nullptr ? x11_->origin() : std::nullopt;
    if (origin && shown.x >= origin->x && shown.y >= origin->y) {
      return shown.size() + cv::Size(2 * (shown.x - origin->x), 2 * (shown.y - origin->y));
    }
#endif
    return shown.size();
  }

  void run_toolkit() {
    check_alive();
    const ToolkitGuard guard;
    const int code = cv::waitKeyEx(1);
    if (x11_ == nullptr && code > 0) {  // without an X server the last key is better than none
      const int low = code & 0xffff;
      const int key = low == 0xff51   ? key::kLeft
                      : low == 0xff52 ? key::kUp
                      : low == 0xff53 ? key::kRight
                      : low == 0xff54 ? key::kDown
                      : low == 0xffff ? key::kDelete
                                      : code & 0xff;
      Event event;
      event.key = key;
      events_.push_back(event);
    }
  }

  void create() {
    check_alive();
    name_ = fmt::format("tarsier-{}-{}", getpid(), ++number_);
    {
      const ToolkitGuard guard;
      const AbortHandler no_abort;
      cv::namedWindow(name_, cv::WINDOW_NORMAL | cv::WINDOW_FREERATIO | cv::WINDOW_GUI_NORMAL);
      cv::setMouseCallback(name_, on_mouse, this);
      has_trackbars_ = !fullscreen_ && !trackbars_.empty();
      if (has_trackbars_) {
        for (const Trackbar& bar : trackbars_) {
          cv::createTrackbar(bar.slider.name, name_, nullptr, bar.steps());
          cv::setTrackbarPos(bar.slider.name, name_, bar.position);
        }
      }
    }
    draw();
    // The X server may lag behind.
    const Clock::time_point deadline = Clock::now() + std::chrono::seconds(2);
    do {
      run_toolkit();
    } while (x11_ != nullptr && !x11_->attach(name_) && Clock::now() < deadline);
    {
      const ToolkitGuard guard;
      cv::setWindowTitle(name_, title_);
    }
    if (fullscreen_) {
      enter_fullscreen();
    } else {
      set_natural_size();
    }
    run_toolkit();
  }

  void enter_fullscreen() {
    {
      const ToolkitGuard guard;
      cv::setWindowProperty(name_, cv::WND_PROP_FULLSCREEN, cv::WINDOW_FULLSCREEN);
      cv::waitKeyEx(1);
    }
    without_window_manager_ = x11_ != nullptr && !x11_->has_window_manager();
    if (without_window_manager_) {
      cover_screen();
      wait_for_size(x11_->screen_size());
    }
  }

  // The toolkit asks the window manager for full screen. Without one (a kiosk) nothing happens.
  void cover_screen() { x11_->set_geometry({{0, 0}, x11_->screen_size()}); }

  // The size arrives as an event. An image drawn before it would be stretched for a moment.
  void wait_for_size(cv::Size size) {
    const Clock::time_point deadline = Clock::now() + milliseconds(300);
    while (view_size() != size && Clock::now() < deadline) run_toolkit();
  }

  void set_natural_size() {
    const cv::Size screen = x11_ != nullptr ? x11_->screen_size() : cv::Size(1920, 1080);
    natural_size_ = initial_size(image_.size(), screen);
    cv::Size window = natural_size_;
    for (int attempt = 0; attempt < 3; ++attempt) {  // sliders take some of the window
      {
        const ToolkitGuard guard;
        cv::resizeWindow(name_, window.width, window.height);
      }
      wait_for_size(natural_size_);
      const cv::Size view = view_size();
      if (view == natural_size_) return;
      window += natural_size_ - view;
      if (window.width < 1 || window.height < 1) break;
    }
    natural_size_ = view_size();  // the desktop may choose another size
  }

  void draw() {
    if (image_.empty()) return;
    shown_size_ = view_size();
    compose(image_, shown_size_, canvas_);
    const ToolkitGuard guard;
    cv::imshow(name_, canvas_);
  }

  void pump() {
    run_toolkit();
    check_alive();
    {
      const ToolkitGuard guard;
      closed_ = cv::getWindowProperty(name_, cv::WND_PROP_VISIBLE) < 1;
    }
    if (x11_ != nullptr && !closed_) closed_ = x11_->destroyed();
    if (closed_) return;
    if (x11_ != nullptr) {
      for (Event& event : x11_->take_keys()) events_.push_back(std::move(event));
      if (fullscreen_) {
        x11_->hide_pointer(true);
        // A size set by the toolkit itself may still be pending.
        const std::optional<cv::Rect> now = x11_->geometry();
        if (without_window_manager_ && now && *now != cv::Rect({0, 0}, x11_->screen_size()))
          cover_screen();
      }
    }
    if (has_trackbars_) {
      for (Trackbar& bar : trackbars_) {
        const ToolkitGuard guard;
        const int position = cv::getTrackbarPos(bar.slider.name, name_);
        if (position < 0 || position == bar.position) continue;
        bar.position = position;
        Event event;
        event.kind = Event::Kind::kSlider;
        event.name = bar.slider.name;
        event.value = bar.value_at(position);
        events_.push_back(event);
      }
    }
    if (view_size() != shown_size_) draw();
  }

  static void on_mouse(int kind, int x, int y, int flags, void* self) {
    static_cast<HighguiWindow*>(self)->take_mouse(kind, x, y, flags);
  }

  void take_mouse(int kind, int x, int y, int flags) {
    if (image_.empty() || shown_size_.empty()) return;
    Event event;
    event.kind = Event::Kind::kMouse;
    switch (kind) {
      case cv::EVENT_MOUSEMOVE:
        event.mouse = Event::Mouse::kMove;
        break;
      case cv::EVENT_LBUTTONDOWN:
        event.mouse = Event::Mouse::kLeftDown;
        break;
      case cv::EVENT_LBUTTONUP:
        event.mouse = Event::Mouse::kLeftUp;
        break;
      case cv::EVENT_RBUTTONDOWN:
        event.mouse = Event::Mouse::kRightDown;
        break;
      case cv::EVENT_RBUTTONUP:
        event.mouse = Event::Mouse::kRightUp;
        break;
      case cv::EVENT_MBUTTONDOWN:
        event.mouse = Event::Mouse::kMiddleDown;
        break;
      case cv::EVENT_MBUTTONUP:
        event.mouse = Event::Mouse::kMiddleUp;
        break;
      case cv::EVENT_LBUTTONDBLCLK:
        event.mouse = Event::Mouse::kDouble;
        break;
      case cv::EVENT_MOUSEWHEEL: {
        event.mouse = Event::Mouse::kWheel;
        const int delta = cv::getMouseWheelDelta(flags);  // 120 per notch
        event.wheel = delta / 120 != 0 ? delta / 120 : (delta > 0) - (delta < 0);
        break;
      }
      default:
        return;
    }
    const cv::Point2d at = fit(image_.size(), shown_size_).to_image(cv::Point2d(x, y));
    event.x = at.x;
    event.y = at.y;
    event.shift = (flags & cv::EVENT_FLAG_SHIFTKEY) != 0;
    event.control = (flags & cv::EVENT_FLAG_CTRLKEY) != 0;
    // A mouse sends hundreds of moves per second; only the latest position matters.
    if (event.mouse == Event::Mouse::kMove && !events_.empty() &&
        events_.back().kind == Event::Kind::kMouse && events_.back().mouse == Event::Mouse::kMove) {
      events_.back() = event;
    } else {
      events_.push_back(event);
    }
  }

  std::string title_;
  bool fullscreen_;
  std::unique_ptr<X11Window> x11_;
  std::vector<Trackbar> trackbars_;
  std::string name_;  // of highgui's window; empty: none yet
  int number_ = 0;
  bool has_trackbars_ = false;
  bool without_window_manager_ = false;  // full screen without a window manager
  bool closed_ = false;
  cv::Mat image_;   // as given
  cv::Mat canvas_;  // as shown
  cv::Size shown_size_;
  cv::Size natural_size_;
  std::deque<Event> events_;
};

}  // namespace
}  // namespace tarsier::window

#define TARSIER_EXPORT __attribute__((visibility("default")))

TARSIER_EXPORT const char* tarsier_window_version() { return TARSIER_VERSION; }

TARSIER_EXPORT void tarsier_window_check_display() { tarsier::window::check_display(); }

TARSIER_EXPORT tarsier::window::Window* tarsier_window_open(
    const tarsier::window::WindowOptions* options) {
  static const bool registered = std::atexit(tarsier::window::on_exit) == 0;
  static_cast<void>(registered);
  return new tarsier::window::HighguiWindow(*options);
}
