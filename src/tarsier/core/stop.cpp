// SPDX-License-Identifier: MIT
#include "tarsier/core/stop.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop_signal.h"

#include <atomic>
#include <condition_variable>
#include <csignal>
#include <mutex>
#include <thread>
#include <unistd.h>

namespace tarsier {
namespace {

std::atomic<int> immediate_ends = 0;
std::atomic<int> first_signal = 0;

void wait_for_signals(const std::stop_source& source, sigset_t signals) {
  int signal_number = 0;
  while (sigwait(&signals, &signal_number) == 0) {
    int none = 0;
    first_signal.compare_exchange_strong(none, signal_number);
    if (immediate_ends > 0 || !source.request_stop()) _exit(128 + SIGINT);  // as shells do
  }
}

std::stop_source start_signal_thread() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::stop_source source;
  std::thread(wait_for_signals, source, signals).detach();
  return source;
}

}  // namespace

std::stop_token stop_on_signals() {
  static const std::stop_source source = start_signal_thread();
  return source.get_token();
}

int stop_signal() { return first_signal; }

EndOnSignals::EndOnSignals() { ++immediate_ends; }

EndOnSignals::~EndOnSignals() { --immediate_ends; }

void throw_if_stopped(const std::stop_token& stop) {
  if (stop.stop_requested()) throw Interrupted();
}

bool sleep_unless_stopped(std::chrono::milliseconds duration, const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any wake;
  std::unique_lock lock(mutex);
  wake.wait_for(lock, stop, duration, [] { return false; });
  return !stop.stop_requested();
}

}  // namespace tarsier
