// SPDX-License-Identifier: MIT
#include "tarsier/core/progress.h"

#include "tarsier/core/measures.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <unistd.h>

namespace tarsier {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto kRedraw = std::chrono::milliseconds(100);
constexpr int kBarWidth = 24;

class PrintedProgress final : public MeasuredProgress {
 public:
  PrintedProgress(std::FILE* out, bool json) : out_(out), json_(json) {}
  ~PrintedProgress() override { end(); }
  PrintedProgress(const PrintedProgress&) = delete;
  PrintedProgress& operator=(const PrintedProgress&) = delete;

  void begin(std::string_view stage, std::int64_t total, std::string_view unit) override {
    const std::lock_guard lock(mutex_);
    finish_stage();
    stage_ = stage;
    unit_ = unit;
    total_ = std::max<std::int64_t>(total, 0);
    done_ = 0;
    measures_.clear();
    is_measured_ = false;
    running_ = true;
    start_ = Clock::now();
    print(start_);
  }

  void advance(std::int64_t count) override {
    const std::lock_guard lock(mutex_);
    done_ += count;
    const auto now = Clock::now();
    if (running_ && (is_measured_ || now - last_ >= kRedraw)) print(now);
  }

  void measure(std::string_view name, double value) override {
    const std::lock_guard lock(mutex_);
    if (!std::isfinite(value)) return;
    measures_[std::string(name)] = value;
    is_measured_ = true;
  }

  void end() override {
    const std::lock_guard lock(mutex_);
    finish_stage();
  }

 private:
  void finish_stage() {
    if (!running_) return;
    print(Clock::now());
    if (!json_) std::fputc('\n', out_);
    std::fflush(out_);
    running_ = false;
  }

  void print(Clock::time_point now) {
    last_ = now;
    is_measured_ = false;
    const double seconds = std::chrono::duration<double>(now - start_).count();
    std::string line;
    if (json_) {
      line = fmt::format(
          "{{\"progress\":\"{}\",\"done\":{},\"total\":{},\"unit\":\"{}\",\"seconds\":{:.1f}",
          stage_, done_, total_ > 0 ? fmt::to_string(total_) : "null", unit_, seconds);
      for (const auto& [name, value] : measures_)
        line += fmt::format(",\"{}\":{:.6g}", name, value);
      line += "}\n";
    } else if (total_ > 0) {
      const double share =
          std::clamp(static_cast<double>(done_) / static_cast<double>(total_), 0.0, 1.0);
      const auto filled = static_cast<size_t>(share * kBarWidth);
      line = fmt::format("\r{:<14} [{}{}] {:3.0f} %  {}/{} {}  {:.1f} s\x1b[K", stage_,
                         std::string(filled, '#'), std::string(kBarWidth - filled, '.'),
                         100 * share, done_, total_, unit_, seconds);
    } else {
      line = fmt::format("\r{:<14} {} {}  {:.1f} s\x1b[K", stage_, done_, unit_, seconds);
    }
    std::fwrite(line.data(), 1, line.size(), out_);
    std::fflush(out_);
  }

  std::FILE* out_;
  bool json_;
  std::mutex mutex_;
  std::string stage_;
  std::string unit_;
  std::int64_t total_ = 0;
  std::int64_t done_ = 0;
  std::map<std::string, double> measures_;
  bool is_measured_ = false;  // since the last line
  bool running_ = false;
  Clock::time_point start_;
  Clock::time_point last_;
};

}  // namespace

ProgressStyle parse_progress_style(std::string_view name) {
  constexpr NameTable<ProgressStyle, 4> kStyles{"progress style",
                                                {{{ProgressStyle::kAuto, "auto"},
                                                  {ProgressStyle::kBar, "bar"},
                                                  {ProgressStyle::kJson, "json"},
                                                  {ProgressStyle::kNone, "none"}}}};
  return kStyles.parse(name);
}

std::unique_ptr<Progress> make_progress(ProgressStyle style, std::FILE* out) {
  if (style == ProgressStyle::kAuto) {
    style = isatty(fileno(out)) != 0 ? ProgressStyle::kBar : ProgressStyle::kNone;
  }
  if (style == ProgressStyle::kNone) return std::make_unique<NoProgress>();
  return std::make_unique<PrintedProgress>(out, style == ProgressStyle::kJson);
}

}  // namespace tarsier
