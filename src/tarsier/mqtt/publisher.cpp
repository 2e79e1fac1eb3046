// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/publisher.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/mqtt/connection.h"
#include "tarsier/mqtt/discovery.h"
#include "tarsier/mqtt/outbox.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <mutex>
#include <optional>
#include <set>
#include <stop_token>
#include <sys/eventfd.h>
#include <thread>
#include <unistd.h>
#include <utility>

namespace tarsier::mqtt {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kMaxResend_s = 600;
constexpr std::chrono::milliseconds kHubTimeout{700};  // wait for its mark at the end
constexpr std::chrono::milliseconds kMinRetryDelay{500};
constexpr std::chrono::milliseconds kMaxRetryDelay{30'000};

Clock::duration seconds(double s) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
}

}  // namespace

class Publisher::Sender {
 public:
  explicit Sender(const PublisherOptions& options)
      : options_((options.check(), options)),
        outbox_(options_.outbox),
        sender_outbox_(options_.outbox),
        wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (wake_ < 0) throw Error(ErrorKind::kInput, "no eventfd for the sender");
    last_ = outbox_.last();
    { const Connection probe(connection_options()); }  // reports invalid options here
    thread_ = std::jthread([this](const std::stop_token& stop) {
      try {
        work(stop);
      } catch (const std::exception& error) {
        log_warning("{}: events are kept, and not sent: {}", shown(), error.what());
      }
    });
  }

  ~Sender() {
    finish(options_.finish_s);
    ::close(wake_);
  }
  Sender(const Sender&) = delete;
  Sender& operator=(const Sender&) = delete;

  void post(const std::string& event) {
    last_ = outbox_.add(event, options_.max_events);
    wake();
  }

  void finish(double timeout_s) {
    if (!thread_.joinable()) return;
    {
      const std::lock_guard lock(mutex_);
      end_ = Clock::now() + seconds(timeout_s);
    }
    is_finishing_ = true;
    wake();
    // The thread ends by itself; do not wait longer for a broker that does not answer.
    while (!is_done_ && Clock::now() < *end_ + seconds(0.5))
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    thread_.request_stop();
    wake();
    thread_.join();
    if (const std::int64_t waiting = outbox_.count(); waiting > 0) {
      log_info("{}: {} {} in {} until a hub has stored {}", shown(), waiting,
               waiting == 1 ? "event stays" : "events stay", options_.outbox,
               waiting == 1 ? "it" : "them");
    }
  }

 private:
  [[nodiscard]] std::string shown() const { return address_text(options_.address); }
  [[nodiscard]] std::string topic(const char* part) const {
    return options_.address.topic + '/' + part;
  }
  void wake() const {
    const std::uint64_t one = 1;
    if (::write(wake_, &one, sizeof one) < 0) return;  // it is awake already
  }
  void reset_wake() const {
    std::uint64_t count = 0;
    if (::read(wake_, &count, sizeof count) < 0) return;
  }

  [[nodiscard]] ConnectionOptions connection_options() const {
    ConnectionOptions options;
    options.address = options_.address;
    options.login = options_.login;
    options.client = fmt::format("tarsier-{}-{}", outbox_.id().substr(0, 8), ::getpid());
    options.will_topic = topic("state");
    options.will = R"({"state":"offline"})";
    return options;
  }

  // Whether the time is over.
  [[nodiscard]] bool is_past_deadline() const {
    if (!is_finishing_) return false;
    const std::lock_guard lock(mutex_);
    return Clock::now() >= *end_;
  }

  void work(const std::stop_token& stop) {
    sigset_t pipe;
    sigemptyset(&pipe);
    sigaddset(&pipe, SIGPIPE);
    ::pthread_sigmask(SIG_BLOCK, &pipe, nullptr);
    std::chrono::milliseconds retry = kMinRetryDelay;
    bool warned = false;
    while (!stop.stop_requested() && !is_past_deadline()) {
      Connection connection(connection_options());
      if (connection.open(stop)) {
        if (std::exchange(warned, false)) log_info("{}: answers again", shown());
        retry = kMinRetryDelay;
        serve(connection, stop);
        if (has_gone_offline_) break;
      }
      if (stop.stop_requested() || is_past_deadline()) break;
      if (!std::exchange(warned, true)) {
        log_warning("{}: {}; events wait in {}", shown(), connection.problem(), options_.outbox);
      }
      // At the end, another try makes sense only if time remains.
      const Clock::time_point again = Clock::now() + retry;
      while (Clock::now() < again && !stop.stop_requested() && !is_past_deadline())
        (void)sleep_unless_stopped(std::chrono::milliseconds(50), stop);
      retry = std::min(2 * retry, kMaxRetryDelay);
    }
    is_done_ = true;
  }

  // Runs while the connection lasts, or until everything was sent.
  void serve(Connection& connection, const std::stop_token& stop) {
    mark_ = sender_outbox_.first() - 1;
    next_ = mark_;
    sent_ahead_.clear();
    unacknowledged_.clear();
    caught_up_to_ = last_;
    resend_s_ = options_.resend_s;
    progress_ = Clock::now();
    connection.publish(topic("state"), R"({"state":"online"})", true);
    if (options_.home_assistant) {
      for (const Message& message :
           home_assistant_discovery(options_.address.topic, options_.version, options_.kind))
        connection.publish(message.topic, message.payload, true);
    }
    connection.subscribe(topic("acked"));
    while (connection.is_open() && !stop.stop_requested()) {
      send(connection);
      if (is_finishing_ && (is_all_delivered(connection) || is_past_deadline())) {
        connection.publish(topic("state"), R"({"state":"offline"})", true);
        connection.step(50);
        connection.close();
        has_gone_offline_ = true;
        return;
      }
      connection.step(is_finishing_ ? 20 : 1000, wake_);
      reset_wake();
      for (const int number : connection.take_acknowledged()) unacknowledged_.erase(number);
      for (const Message& message : connection.take_messages()) {
        if (const auto mark = parse_mark(message.payload)) handle_mark(*mark);
      }
      if (mark_ < last_ && Clock::now() - progress_ > seconds(resend_s_)) {
        next_ = mark_;
        sent_ahead_.clear();
        progress_ = Clock::now();
        resend_s_ = std::min(2 * resend_s_, kMaxResend_s);
      }
    }
  }

  // Whether the broker has all events that can be sent now, and a hub, if there is one, had a
  // moment to confirm them.
  [[nodiscard]] bool is_all_delivered(const Connection& connection) {
    const bool is_sent = next_ >= last_ || next_ - mark_ >= options_.window;
    if (!connection.is_open() || !is_sent || !unacknowledged_.empty()) {
      delivered_at_.reset();
      return false;
    }
    if (!delivered_at_) delivered_at_ = Clock::now();
    return mark_ >= last_ || Clock::now() - *delivered_at_ > kHubTimeout;
  }

  void handle_mark(const Mark& mark) {
    if (mark.outbox != outbox_.id()) return;
    const std::int64_t seq = std::min<std::int64_t>(mark.seq, last_);
    if (seq > mark_) {
      mark_ = seq;
      next_ = std::max(next_, mark_);
      (void)sender_outbox_.forget(seq);
      sent_ahead_.erase(sent_ahead_.begin(), sent_ahead_.upper_bound(seq));
      resend_s_ = options_.resend_s;
    }
    progress_ = Clock::now();
  }

  // Older events are sent in order, one window at a time; new events are sent at once.
  void send(Connection& connection) {
    const std::int64_t last = last_;
    const std::int64_t oldest = sender_outbox_.first();
    const auto publish_event = [&](std::int64_t seq, const std::string& payload) {
      const int number = connection.publish(
          topic("events"), event_message_text({outbox_.id(), seq, std::min(oldest, seq), payload}),
          false);
      unacknowledged_.insert(number);
      return connection.is_open();
    };
    if (next_ < last && next_ < mark_ + options_.window) {
      sender_outbox_.read(next_, [&](std::int64_t seq, const std::string& payload) {
        if (seq > last || seq > mark_ + options_.window) return false;
        next_ = seq;
        return sent_ahead_.contains(seq) || publish_event(seq, payload);
      });
      // The oldest events may have been dropped.
      if (next_ < oldest - 1) next_ = mark_ = oldest - 1;
    }
    if (next_ < last) {
      sender_outbox_.read(std::max(next_, caught_up_to_),
                          [&](std::int64_t seq, const std::string& text) {
                            if (seq > last) return false;
                            if (!sent_ahead_.insert(seq).second) return true;
                            return publish_event(seq, text);
                          });
      if (sent_ahead_.size() > kMaxSentAhead) sent_ahead_.erase(sent_ahead_.begin());
    }
    caught_up_to_ = last;
  }

  static constexpr std::size_t kMaxSentAhead = 100'000;

  const PublisherOptions options_;
  Outbox outbox_;         // for callers of post()
  Outbox sender_outbox_;  // the same file, for the thread
  const int wake_;
  std::atomic<std::int64_t> last_ = 0;
  std::atomic<bool> is_finishing_ = false;
  std::atomic<bool> is_done_ = false;
  mutable std::mutex mutex_;
  std::optional<Clock::time_point> end_;

  // Used by the thread: a hub has stored events up to mark_; events up to next_ are sent in order,
  // and also those in sent_ahead_.
  std::int64_t mark_ = 0;
  std::int64_t next_ = 0;
  std::set<std::int64_t> sent_ahead_;
  std::int64_t caught_up_to_ = 0;
  std::set<int> unacknowledged_;
  double resend_s_ = 0;
  Clock::time_point progress_{};
  bool has_gone_offline_ = false;
  std::optional<Clock::time_point> delivered_at_;
  std::jthread thread_;  // last: ends before the other members
};

Publisher::Publisher(const PublisherOptions& options)
    : sender_(std::make_unique<Sender>(options)) {}
Publisher::~Publisher() = default;
void Publisher::post(const std::string& event) { sender_->post(event); }
void Publisher::finish(double timeout_s) { sender_->finish(timeout_s); }

std::string default_outbox(const std::string& topic) {
  std::string name = topic;
  std::replace(name.begin(), name.end(), '/', '-');
  const char* state = std::getenv("XDG_STATE_HOME");
  if (state != nullptr && *state == '/') return fmt::format("{}/tarsier/outbox-{}.db", state, name);
  const char* home = std::getenv("HOME");
  if (home == nullptr || *home != '/')
    throw UsageError("option 'outbox': give a file, as neither XDG_STATE_HOME nor HOME is set");
  return fmt::format("{}/.local/state/tarsier/outbox-{}.db", home, name);
}

}  // namespace tarsier::mqtt
