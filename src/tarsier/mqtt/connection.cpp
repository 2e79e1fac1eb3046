// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/connection.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/tcp.h"

#include <fmt/format.h>

#include <chrono>
#include <dlfcn.h>
#include <poll.h>
#include <unistd.h>
#include <utility>

#ifdef TARSIER_MOSQUITTO
#include <mosquitto.h>
#endif

namespace tarsier::mqtt {

#ifdef TARSIER_MOSQUITTO
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kConnectTimeout{4000};
constexpr int kKeepAlive_s = 20;
constexpr const char* kSystemAuthorities = "/etc/ssl/certs";

// libmosquitto's functions; never unloaded.
struct Library {
  decltype(&mosquitto_lib_init) lib_init = nullptr;
  decltype(&mosquitto_lib_version) lib_version = nullptr;
  decltype(&mosquitto_new) create = nullptr;
  decltype(&mosquitto_destroy) destroy = nullptr;
  decltype(&mosquitto_will_set) will_set = nullptr;
  decltype(&mosquitto_username_pw_set) username_pw_set = nullptr;
  decltype(&mosquitto_tls_set) tls_set = nullptr;
  decltype(&mosquitto_connect) connect = nullptr;
  decltype(&mosquitto_disconnect) disconnect = nullptr;
  decltype(&mosquitto_publish) publish = nullptr;
  decltype(&mosquitto_subscribe) subscribe = nullptr;
  decltype(&mosquitto_loop) loop = nullptr;
  decltype(&mosquitto_socket) socket = nullptr;
  decltype(&mosquitto_want_write) want_write = nullptr;
  decltype(&mosquitto_connect_callback_set) connect_callback_set = nullptr;
  decltype(&mosquitto_disconnect_callback_set) disconnect_callback_set = nullptr;
  decltype(&mosquitto_publish_callback_set) publish_callback_set = nullptr;
  decltype(&mosquitto_message_callback_set) message_callback_set = nullptr;
  decltype(&mosquitto_strerror) strerror = nullptr;
  decltype(&mosquitto_connack_string) connack_string = nullptr;
  std::string missing;  // why it could not be loaded

  Library() {
    void* handle = ::dlopen("libmosquitto.so.1", RTLD_NOW | RTLD_LOCAL);
    if (handle == nullptr) {
      missing = "libmosquitto is not installed: sudo apt install libmosquitto1";
      return;
    }
    find(handle, lib_init, "mosquitto_lib_init");
    find(handle, lib_version, "mosquitto_lib_version");
    find(handle, create, "mosquitto_new");
    find(handle, destroy, "mosquitto_destroy");
    find(handle, will_set, "mosquitto_will_set");
    find(handle, username_pw_set, "mosquitto_username_pw_set");
    find(handle, tls_set, "mosquitto_tls_set");
    find(handle, connect, "mosquitto_connect");
    find(handle, disconnect, "mosquitto_disconnect");
    find(handle, publish, "mosquitto_publish");
    find(handle, subscribe, "mosquitto_subscribe");
    find(handle, loop, "mosquitto_loop");
    find(handle, socket, "mosquitto_socket");
    find(handle, want_write, "mosquitto_want_write");
    find(handle, connect_callback_set, "mosquitto_connect_callback_set");
    find(handle, disconnect_callback_set, "mosquitto_disconnect_callback_set");
    find(handle, publish_callback_set, "mosquitto_publish_callback_set");
    find(handle, message_callback_set, "mosquitto_message_callback_set");
    find(handle, strerror, "mosquitto_strerror");
    find(handle, connack_string, "mosquitto_connack_string");
    if (missing.empty()) lib_init();
  }

  template <class Function>
  void find(void* handle, Function& function, const char* name) {
    function = reinterpret_cast<Function>(::dlsym(handle, name));
    if (function == nullptr)
      missing = fmt::format("libmosquitto lacks {}: install a newer one", name);
  }

  static const Library& any() {
    static const Library kLibrary;
    return kLibrary;
  }

  static const Library& get() {
    const Library& library = any();
    if (!library.missing.empty()) throw Error(ErrorKind::kInput, library.missing);
    return library;
  }
};

// Converts "The connection was lost." to a part of our own line.
std::string as_clause(std::string text) {
  if (text.ends_with('.')) text.pop_back();
  if (!text.empty() && text[0] >= 'A' && text[0] <= 'Z' && text.size() > 1 && text[1] >= 'a')
    text[0] = static_cast<char>(text[0] - 'A' + 'a');
  return text;
}

void check_readable(const std::string& path) {
  if (!path.empty()) (void)read_file(path, 10'000'000);
}

std::string password_of(const ConnectionOptions& options) {
  if (options.login.password_file.empty()) return options.address.password;
  const std::string text = read_file(options.login.password_file, 10'000);
  std::string_view rest = text;
  return std::string(trimmed(next_line(rest)));
}

}  // namespace

std::string library_version(std::string& reason) {
  const Library& library = Library::any();
  reason = library.missing;
  if (!reason.empty()) return {};
  int major = 0;
  int minor = 0;
  int revision = 0;
  library.lib_version(&major, &minor, &revision);
  return fmt::format("{}.{}.{}", major, minor, revision);
}

class Connection::Client {
 public:
  explicit Client(ConnectionOptions options)
      : options_(std::move(options)), library_(Library::get()) {
    check_readable(options_.login.ca_file);
    check_readable(options_.login.certificate);
    check_readable(options_.login.key);
    const std::string password = password_of(options_);
    handle_ = library_.create(options_.client.c_str(), !options_.keeps_session, this);
    if (handle_ == nullptr) throw Error(ErrorKind::kInput, "libmosquitto: no client");
    const std::string& user =
        options_.address.user.empty() ? options_.login.user : options_.address.user;
    if (!user.empty())
      check(library_.username_pw_set(handle_, user.c_str(),
                                     password.empty() ? nullptr : password.c_str()));
    if (options_.address.tls) set_tls();
    if (!options_.will_topic.empty()) {
      check(library_.will_set(handle_, options_.will_topic.c_str(),
                              static_cast<int>(options_.will.size()), options_.will.data(), 1,
                              true));
    }
    library_.connect_callback_set(handle_, [](mosquitto*, void* self, int code) {
      static_cast<Client*>(self)->connected(code);
    });
    library_.disconnect_callback_set(
        handle_, [](mosquitto*, void* self, int code) { static_cast<Client*>(self)->lost(code); });
    library_.publish_callback_set(handle_, [](mosquitto*, void* self, int number) {
      static_cast<Client*>(self)->acknowledged_.push_back(number);
    });
    library_.message_callback_set(handle_,
                                  [](mosquitto*, void* self, const mosquitto_message* message) {
                                    static_cast<Client*>(self)->received(*message);
                                  });
  }
  ~Client() { library_.destroy(handle_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  bool open(const std::stop_token& stop) {
    // Checks first whether anybody answers; the library would wait for minutes.
    LiveFailure failure;
    const TcpSocket probe =
        connect_tcp(options_.address.host, options_.address.port, kConnectTimeout, stop, failure);
    if (!probe.is_open()) {
      problem_ = failure.reason.empty() ? "does not answer" : failure.reason;
      is_over_ = true;
      return false;
    }
    const int code = library_.connect(handle_, options_.address.host.c_str(), options_.address.port,
                                      kKeepAlive_s);
    if (code != MOSQ_ERR_SUCCESS) {
      fail(code);
      return false;
    }
    const auto end = std::chrono::steady_clock::now() + kConnectTimeout;
    while (!is_open_ && !is_over_ && !stop.stop_requested()) {
      if (std::chrono::steady_clock::now() >= end) {
        problem_ = "does not answer as an MQTT broker";
        is_over_ = true;
        break;
      }
      step(100, -1);
    }
    return is_open_;
  }

  void step(int timeout_ms, int wake) {
    if (is_over_) return;
    pollfd descriptors[2] = {{library_.socket(handle_), POLLIN, 0}, {wake, POLLIN, 0}};
    if (library_.want_write(handle_)) descriptors[0].events |= POLLOUT;
    ::poll(descriptors, wake >= 0 ? 2 : 1, timeout_ms);
    const int code = library_.loop(handle_, 0, 1);
    if (code != MOSQ_ERR_SUCCESS && !is_over_) fail(code);
  }

  void subscribe(const std::string& topic) {
    const int code = library_.subscribe(handle_, nullptr, topic.c_str(), 1);
    if (code != MOSQ_ERR_SUCCESS) fail(code);
  }

  int publish(const std::string& topic, const std::string& payload, bool retained) {
    int number = 0;
    const int code =
        library_.publish(handle_, &number, topic.c_str(), static_cast<int>(payload.size()),
                         payload.data(), 1, retained);
    if (code != MOSQ_ERR_SUCCESS) fail(code);
    return number;
  }

  void close() {
    if (!is_over_) {
      library_.disconnect(handle_);
      for (int k = 0; k < 20 && !is_over_; ++k) step(50, -1);
    }
    is_open_ = false;
    is_over_ = true;
  }

  [[nodiscard]] bool is_open() const { return is_open_ && !is_over_; }
  [[nodiscard]] bool is_over() const { return is_over_; }
  [[nodiscard]] const std::string& problem() const { return problem_; }
  std::vector<int> take_acknowledged() { return std::exchange(acknowledged_, {}); }
  std::vector<Message> take_messages() { return std::exchange(messages_, {}); }

 private:
  void set_tls() {
    const auto text = [](const std::string& path) { return path.empty() ? nullptr : path.c_str(); };
    const Login& login = options_.login;
    const int code = library_.tls_set(
        handle_, text(login.ca_file), login.ca_file.empty() ? kSystemAuthorities : nullptr,
        text(login.certificate), text(login.key),
        [](char*, int, int, void*) { return 0; });  // never prompts for a password
    if (code != MOSQ_ERR_SUCCESS) {
      throw InputError(login.certificate.empty() ? login.ca_file : login.certificate,
                       fmt::format("cannot be used for TLS: {}", library_.strerror(code)));
    }
  }

  void check(int code) const {
    if (code != MOSQ_ERR_SUCCESS) {
      throw InputError(address_text(options_.address),
                       fmt::format("libmosquitto: {}", library_.strerror(code)));
    }
  }

  void connected(int code) {
    if (code == 0) {
      is_open_ = true;
      return;
    }
    problem_ = fmt::format("refuses us: {}", as_clause(library_.connack_string(code)));
    is_over_ = true;
  }

  void lost(int code) {
    if (!is_over_ && code != 0) fail(code);
    is_over_ = true;
  }

  void fail(int code) {
    if (problem_.empty()) problem_ = as_clause(library_.strerror(code));
    is_over_ = true;
  }

  void received(const mosquitto_message& message) {
    if (message.payloadlen < 0 ||
        static_cast<std::size_t>(message.payloadlen) > options_.max_message)
      return;
    const auto* bytes = static_cast<const char*>(message.payload);
    messages_.push_back(
        {message.topic,
         std::string(bytes == nullptr ? "" : bytes, static_cast<std::size_t>(message.payloadlen)),
         message.retain});
  }

  const ConnectionOptions options_;
  const Library& library_;
  mosquitto* handle_ = nullptr;
  bool is_open_ = false;
  bool is_over_ = false;
  std::string problem_;
  std::vector<int> acknowledged_;
  std::vector<Message> messages_;
};

#else

std::string library_version(std::string& reason) {
  reason = "this build has no MQTT: install libmosquitto-dev and build again";
  return {};
}

class Connection::Client {
 public:
  explicit Client(const ConnectionOptions&) {
    std::string reason;
    (void)library_version(reason);
    throw Error(ErrorKind::kInput, reason);
  }
  bool open(const std::stop_token&) { return false; }
  void step(int, int) {}
  void subscribe(const std::string&) {}
  int publish(const std::string&, const std::string&, bool) { return 0; }
  void close() {}
  [[nodiscard]] bool is_open() const { return false; }
  [[nodiscard]] bool is_over() const { return true; }
  [[nodiscard]] const std::string& problem() const { return problem_; }
  std::vector<int> take_acknowledged() { return {}; }
  std::vector<Message> take_messages() { return {}; }

 private:
  std::string problem_;
};

#endif

Connection::Connection(const ConnectionOptions& options)
    : client_(std::make_unique<Client>(options)) {}
Connection::~Connection() = default;
bool Connection::open(const std::stop_token& stop) { return client_->open(stop); }
void Connection::step(int timeout_ms, int wake) { client_->step(timeout_ms, wake); }
bool Connection::is_open() const { return client_->is_open(); }
bool Connection::is_over() const { return client_->is_over(); }
const std::string& Connection::problem() const { return client_->problem(); }
void Connection::subscribe(const std::string& topic) { client_->subscribe(topic); }
int Connection::publish(const std::string& topic, const std::string& payload, bool retained) {
  return client_->publish(topic, payload, retained);
}
std::vector<int> Connection::take_acknowledged() { return client_->take_acknowledged(); }
std::vector<Message> Connection::take_messages() { return client_->take_messages(); }
void Connection::close() { client_->close(); }

}  // namespace tarsier::mqtt
