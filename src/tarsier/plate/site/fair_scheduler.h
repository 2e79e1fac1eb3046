// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace tarsier::plate {

// Which of several cameras is served next, so that each gets the same share of the work when there
// is more than can be done. Start-time fair queuing (Goyal, Vin, Cheng, SIGCOMM 1996) with one
// request a camera: each camera has a clock, which its own work moves on; the one that is furthest
// behind is next. A camera that had nothing to do does not save up: its clock is brought up to the
// one of the request that was taken last.
//
// What is offered as spare is taken only while no other request waits. Not thread-safe.
class FairScheduler {
 public:
  explicit FairScheduler(std::size_t cameras);

  // The camera has a request, in place of the one that it may have already; `spare` holds only if
  // both were.
  void offer(std::size_t camera, bool spare);

  // The next camera, of those that are not being served; the lowest number of equal ones. It is
  // being served until done().
  [[nodiscard]] std::optional<std::size_t> take();
  void done(std::size_t camera, double cost_s);

 private:
  struct Camera {
    bool waits = false;
    bool is_spare = false;
    bool is_served = false;
    double clock_s = 0;
  };
  std::vector<Camera> cameras_;
  double now_s_ = 0;  // the clock of the request that was taken last
};

}  // namespace tarsier::plate
