// SPDX-License-Identifier: MIT
#include "x11_window.h"

#include <X11/XKBlib.h>
#include <X11/Xatom.h>
#include <X11/Xlib.h>
#include <X11/Xutil.h>
#include <X11/keysym.h>
#include <cerrno>
#include <poll.h>
#include <set>
#include <string>
#include <unistd.h>

namespace tarsier::window {
namespace {

// The default handlers end the process. A window that was just closed is no reason for that, and
// alive() reports a lost server.
int ignore_error(Display*, XErrorEvent*) { return 0; }
int ignore_io_error(Display*) { return 0; }

// Converts a key to the codes of sessions; 0 if there is none.
int session_key(KeySym symbol, char character) {
  switch (symbol) {
    case XK_Left:
    case XK_KP_Left:
      return key::kLeft;
    case XK_Right:
    case XK_KP_Right:
      return key::kRight;
    case XK_Up:
    case XK_KP_Up:
      return key::kUp;
    case XK_Down:
    case XK_KP_Down:
      return key::kDown;
    case XK_Delete:
    case XK_KP_Delete:
      return key::kDelete;
    case XK_Escape:
      return key::kEscape;
    case XK_Return:
    case XK_KP_Enter:
      return key::kEnter;
    case XK_BackSpace:
      return key::kBackspace;
    case XK_Tab:
    case XK_ISO_Left_Tab:
      return key::kTab;
    default:
      return character >= 32 && character < 127 ? character : 0;
  }
}

bool repeats_when_held(int key) {
  return key == key::kLeft || key == key::kRight || key == key::kUp || key == key::kDown ||
         key == key::kDelete || key == key::kBackspace || key == '+' || key == '-';
}

}  // namespace

struct X11Window::Impl {
  Display* display = nullptr;
  ::Window root = None;
  ::Window window = None;
  ::Cursor empty = None;
  bool connection_lost = false;
  bool destroyed = false;
  bool hidden = false;
  std::set<unsigned> pressed_keys;  // key codes that are held down

  ~Impl() {
    // Closing a broken connection would contact the server again.
    if (display != nullptr && !connection_lost) XCloseDisplay(display);
  }

  template <typename T>
  std::vector<T> property(::Window of, const char* name, Atom type) {
    Atom actual = None;
    int format = 0;
    unsigned long count = 0;
    unsigned long rest = 0;
    unsigned char* data = nullptr;
    std::vector<T> values;
    if (XGetWindowProperty(display, of, XInternAtom(display, name, False), 0, 1024, False, type,
                           &actual, &format, &count, &rest, &data) == Success &&
        data != nullptr) {
      const T* first = reinterpret_cast<const T*>(data);
      if (actual != None && format == (sizeof(T) == 1 ? 8 : 32))
        values.assign(first, first + count);
      XFree(data);
    }
    return values;
  }

  bool is_own_window(::Window candidate, const std::string& name) {
    // 32-bit properties are returned as longs, whatever the size of a long.
    const std::vector<unsigned long> pid =
        property<unsigned long>(candidate, "_NET_WM_PID", AnyPropertyType);
    if (pid.empty() || pid.front() != static_cast<unsigned long>(getpid())) return false;
    for (const char* property_name : {"_NET_WM_NAME", "WM_NAME"}) {
      const std::vector<char> text = property<char>(candidate, property_name, AnyPropertyType);
      if (std::string(text.begin(), text.end()) == name) return true;
    }
    return false;
  }

  ::Window find(::Window in, const std::string& name, int depth) {
    ::Window root_of = None;
    ::Window parent = None;
    ::Window* children = nullptr;
    unsigned count = 0;
    ::Window found = None;
    if (XQueryTree(display, in, &root_of, &parent, &children, &count) == 0) return None;
    for (unsigned i = 0; i < count && found == None; ++i) {
      if (is_own_window(children[i], name)) found = children[i];
    }
    for (unsigned i = 0; i < count && found == None && depth > 0;
         ++i) {  // window managers put it in frames
      found = find(children[i], name, depth - 1);
    }
    if (children != nullptr) XFree(children);
    return found;
  }
};

X11Window::X11Window(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
X11Window::~X11Window() { detach(); }

std::unique_ptr<X11Window> X11Window::connect() {
  XSetErrorHandler(ignore_error);
  XSetIOErrorHandler(ignore_io_error);
  auto impl = std::make_unique<Impl>();
  impl->display = XOpenDisplay(nullptr);
  if (impl->display == nullptr) return nullptr;
  impl->root = DefaultRootWindow(impl->display);
  XSetIOErrorExitHandler(
      impl->display, [](Display*, void* data) { static_cast<Impl*>(data)->connection_lost = true; },
      impl.get());
  XkbSetDetectableAutoRepeat(impl->display, True, nullptr);
  return std::unique_ptr<X11Window>(new X11Window(std::move(impl)));
}

bool X11Window::attach(const std::string& name) {
  if (!alive()) return false;
  XSetErrorHandler(ignore_error);  // the toolkit has set its own handler meanwhile
  const ::Window found = impl_->find(impl_->root, name, 3);
  if (found == None) return false;
  impl_->window = found;
  impl_->destroyed = false;
  impl_->pressed_keys.clear();
  XSelectInput(impl_->display, found,
               KeyPressMask | KeyReleaseMask | FocusChangeMask | StructureNotifyMask);
  XFlush(impl_->display);
  return true;
}

void X11Window::detach() {
  if (impl_->window == None || !alive()) return;
  hide_pointer(false);
  XSelectInput(impl_->display, impl_->window, NoEventMask);
  XSync(impl_->display, True);
  impl_->window = None;
}

bool X11Window::alive() {
  if (impl_->connection_lost) return false;
  pollfd fd{ConnectionNumber(impl_->display), POLLIN, 0};
  if (::poll(&fd, 1, 0) > 0 && (fd.revents & (POLLHUP | POLLERR | POLLNVAL)) != 0)
    impl_->connection_lost = true;
  return !impl_->connection_lost;
}

bool X11Window::destroyed() const { return impl_->destroyed; }

cv::Size X11Window::screen_size() const {
  const int screen = DefaultScreen(impl_->display);
  return {DisplayWidth(impl_->display, screen), DisplayHeight(impl_->display, screen)};
}

bool X11Window::has_window_manager() {
  if (!alive()) return false;
  const std::vector<unsigned long> check =
      impl_->property<unsigned long>(impl_->root, "_NET_SUPPORTING_WM_CHECK", XA_WINDOW);
  return !check.empty();
}

void X11Window::hide_pointer(bool hidden) {
  if (impl_->window == None || !alive() || (!hidden && !impl_->hidden)) return;
  if (hidden && impl_->empty == None) {
    const char nothing[8] = {};
    XColor black{};
    const Pixmap bits = XCreateBitmapFromData(impl_->display, impl_->window, nothing, 8, 8);
    impl_->empty = XCreatePixmapCursor(impl_->display, bits, bits, &black, &black, 0, 0);
    XFreePixmap(impl_->display, bits);
  }
  if (hidden) {
    XDefineCursor(impl_->display, impl_->window, impl_->empty);
  } else {
    XUndefineCursor(impl_->display, impl_->window);
  }
  impl_->hidden = hidden;
  XFlush(impl_->display);
}

void X11Window::set_geometry(const cv::Rect& where) {
  if (impl_->window == None || !alive()) return;
  XMoveResizeWindow(impl_->display, impl_->window, where.x, where.y,
                    static_cast<unsigned>(where.width), static_cast<unsigned>(where.height));
  XRaiseWindow(impl_->display, impl_->window);
  XFlush(impl_->display);
}

std::optional<cv::Rect> X11Window::geometry() {
  if (impl_->window == None || !alive()) return std::nullopt;
  XWindowAttributes attributes{};
  if (XGetWindowAttributes(impl_->display, impl_->window, &attributes) == 0) return std::nullopt;
  return cv::Rect(attributes.x, attributes.y, attributes.width, attributes.height);
}

std::optional<cv::Point> X11Window::origin() {
  if (impl_->window == None || !alive()) return std::nullopt;
  int x = 0;
  int y = 0;
  ::Window child = None;
  if (XTranslateCoordinates(impl_->display, impl_->window, DefaultRootWindow(impl_->display), 0, 0,
                            &x, &y, &child) == 0) {
    return std::nullopt;
  }
  return cv::Point(x, y);
}

std::vector<Event> X11Window::take_keys() {
  std::vector<Event> events;
  while (alive() && XPending(impl_->display) > 0) {
    XEvent event{};
    XNextEvent(impl_->display, &event);
    if (event.type == MappingNotify) {
      XRefreshKeyboardMapping(&event.xmapping);
    } else if (event.type == DestroyNotify && event.xdestroywindow.window == impl_->window) {
      impl_->destroyed = true;
      impl_->window = None;
    } else if (event.type == FocusOut) {
      impl_->pressed_keys.clear();  // another window will get the release
    } else if (event.type == KeyRelease) {
      impl_->pressed_keys.erase(event.xkey.keycode);
    } else if (event.type == KeyPress) {
      char text[8] = {};
      KeySym symbol = NoSymbol;
      const bool alt = (event.xkey.state & (Mod1Mask | Mod4Mask)) != 0;
      const bool control = (event.xkey.state & ControlMask) != 0;
      event.xkey.state &= ~static_cast<unsigned>(ControlMask);  // else Ctrl+C would be character 3
      const int length = XLookupString(&event.xkey, text, sizeof text, &symbol, nullptr);
      const int code = session_key(symbol, length == 1 ? text[0] : '\0');
      const bool held = !impl_->pressed_keys.insert(event.xkey.keycode).second;
      if (code == 0 || alt || (held && !repeats_when_held(code)))
        continue;  // Alt+.. is for the desktop
      Event key;
      key.key = code;
      key.shift = (event.xkey.state & ShiftMask) != 0;
      key.control = control;
      events.push_back(key);
    }
  }
  return events;
}

void X11Window::wait(std::chrono::milliseconds timeout) {
  if (!alive() || XPending(impl_->display) > 0) return;
  pollfd fd{ConnectionNumber(impl_->display), POLLIN, 0};
  ::poll(&fd, 1, static_cast<int>(timeout.count()));
}

}  // namespace tarsier::window
