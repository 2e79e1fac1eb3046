// SPDX-License-Identifier: MIT
// Linked into everything that is built for the thread sanitizer: lets OpenCV's parallel loops run
// on std::threads that it sees from start to end. The threads of TBB, which OpenCV would use, hand
// work to each other in code that is built without the sanitizer: it may report races that are
// none, or miss real ones.
#include <opencv2/core/parallel/parallel_backend.hpp>

#include <algorithm>
#include <atomic>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace {

thread_local int thread_number = 0;

class PlainThreads final : public cv::parallel::ParallelForAPI {
 public:
  void parallel_for(int tasks, FN_parallel_for_body_cb_t body, void* data) override {
    std::atomic<int> next{0};
    std::exception_ptr first_error;
    std::mutex mutex;
    const auto work = [&](int thread) {
      thread_number = thread;
      try {
        for (int task = next++; task < tasks; task = next++) body(task, task + 1, data);
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (!first_error) first_error = std::current_exception();
      }
    };
    {
      std::vector<std::jthread> others;
      for (int i = 1; i < std::min(tasks, threads_); ++i) others.emplace_back(work, i);
      work(0);
    }
    if (first_error) std::rethrow_exception(first_error);
  }
  int getThreadNum() const override { return thread_number; }
  int getNumThreads() const override { return threads_; }
  int setNumThreads(int threads) override {
    const int before = threads_;
    threads_ = threads > 0 ? threads : kDefault;
    return before;
  }
  const char* getName() const override { return "plain threads"; }

 private:
  static constexpr int kDefault = 4;  // more than one also where there is one processor
  int threads_ = kDefault;
};

const bool is_installed = [] {
  cv::parallel::setParallelForBackend(std::make_shared<PlainThreads>(), false);
  return true;
}();

}  // namespace
