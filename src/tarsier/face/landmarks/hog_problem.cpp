// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/hog_problem.h"

#include "tarsier/core/stop.h"
#include "tarsier/face/landmarks/hog_solver.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cstddef>
#include <dlib/svm/structural_svm_object_detection_problem.h>
#include <utility>

namespace tarsier::face::landmarks::inner {
namespace {

// dlib's problem, but with a summation order that does not depend on the number of threads, and
// with a stop check between images.
class DetectionProblem final
    : public dlib::structural_svm_object_detection_problem<HogScanner, std::vector<cv::Mat>> {
 public:
  DetectionProblem(const HogScanner& scanner, const std::vector<cv::Mat>& all,
                   const DlibObjects& objects, const DlibIgnored& left_out, Progress& progress,
                   std::stop_token stop)
      : structural_svm_object_detection_problem(
            scanner, dlib::test_box_overlap(), true, all, objects, left_out,
            dlib::test_box_overlap(0.4, 0.7),
            static_cast<unsigned long>(std::max(1, cv::getNumThreads()))),
        count_(static_cast<long>(all.size())),
        progress_(progress),
        stop_(std::move(stop)) {}

  [[nodiscard]] int rounds() const { return rounds_; }

 private:
  void call_separation_oracle_on_all_samples(const matrix_type& weights, matrix_type& subgradient,
                                             scalar_type& total_loss) const override {
    constexpr long kBlock = 64;
    std::vector<scalar_type> losses(kBlock);
    std::vector<feature_vector_type> features(kBlock);
    for (long first = 0; first < count_; first += kBlock) {
      const long end = std::min(count_, first + kBlock);
      cv::parallel_for_(cv::Range(0, static_cast<int>(end - first)), [&](const cv::Range& range) {
        for (int k = range.start; k < range.end && !stop_.stop_requested(); ++k) {
          const auto index = static_cast<std::size_t>(k);
          separation_oracle_cached(first + k, weights, losses[index], features[index]);
        }
      });
      throw_if_stopped(stop_);
      for (long i = first; i < end; ++i) {
        const auto index = static_cast<std::size_t>(i - first);
        total_loss += losses[index];
        subgradient += features[index];
      }
    }
    ++rounds_;
    progress_.advance();
  }

  long count_;
  Progress& progress_;
  std::stop_token stop_;
  mutable int rounds_ = 0;
};

}  // namespace

std::optional<HogSolution> solve_detection_problem(const HogScanner& scanner,
                                                   const std::vector<cv::Mat>& images,
                                                   const DlibObjects& objects,
                                                   const DlibIgnored& ignored,
                                                   const HogOptions& options, Progress& progress,
                                                   const std::stop_token& stop) {
  try {
    DetectionProblem problem(scanner, images, objects, ignored, progress, stop);
    throw_if_stopped(stop);
    problem.set_c(options.c);
    problem.set_epsilon(options.epsilon);
    problem.set_max_iterations(static_cast<unsigned long>(options.rounds));
    problem.set_match_eps(kMinMatchOverlap);
    HogSolution solution;
    solution.weights = minimize_risk(problem);
    solution.overlap = problem.get_overlap_tester().get_iou_thresh();
    solution.covered = problem.get_overlap_tester().get_percent_covered_thresh();
    solution.rounds = problem.rounds();
    return solution;
  } catch (const dlib::impossible_labeling_error&) {
    return std::nullopt;
  }
}

}  // namespace tarsier::face::landmarks::inner
