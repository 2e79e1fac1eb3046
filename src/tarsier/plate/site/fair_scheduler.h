// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace tarsier::plate {

// Chooses which of several cameras is served next. Each camera gets the same share of the work when
// the machine is overloaded. The algorithm is start-time fair queuing (Goyal, Vin, Cheng, SIGCOMM
// 1996) with one pending request per camera. Each camera has a virtual clock, which its own work
// advances. The camera whose clock is furthest behind is served next. An idle camera does not save
// up time: when it has a request again, its clock is set at least to that of the request taken
// last.
//
// A request of low priority is taken only while no other request waits. The class is not
// thread-safe.
class FairScheduler {
 public:
  explicit FairScheduler(std::size_t cameras);

  // Adds a request of the camera, or replaces its pending request. The replacement has a low
  // priority only if the pending request and the new one both have it.
  void offer(std::size_t camera, bool low_priority);

  // Returns the next camera among those not being served; with equal clocks, the one with the
  // lowest number. The camera counts as being served until done().
  [[nodiscard]] std::optional<std::size_t> take();
  void done(std::size_t camera, double cost_s);

 private:
  struct Camera {
    bool has_request = false;
    bool is_low_priority = false;
    bool is_served = false;
    double clock_s = 0;
  };
  std::vector<Camera> cameras_;
  double now_s_ = 0;  // of the request taken last
};

}  // namespace tarsier::plate
