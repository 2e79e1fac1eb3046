// SPDX-License-Identifier: MIT
// The kernels of the cartoon filters for each instruction set, on one thread, compared with the
// OpenCV functions that they replace.
#include "tarsier/cartoon/bilateral.h"
#include "tarsier/cartoon/kernels.h"
#include "tarsier/cartoon/plane.h"
#include "tarsier/core/cpu.h"
#include "tarsier/core/rng.h"

#include <benchmark/benchmark.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <string>
#include <vector>

namespace tarsier::cartoon {
namespace {

constexpr int kWidth = 640;
constexpr int kHeight = 480;

cv::Mat image(int channels) {
  Rng rng(1);
  cv::Mat noise(kHeight, kWidth, CV_8UC(channels));
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth * channels; ++x) {
      noise.ptr(y)[x] = cv::saturate_cast<std::uint8_t>(rng.normal(120, 40));
    }
  }
  cv::Mat smooth;
  cv::GaussianBlur(noise, smooth, {9, 9}, 2);
  return smooth;
}

Plane plane_with_margin() {
  Plane plane;
  plane.resize(kWidth, kHeight);
  image(1).copyTo(plane.view());
  for (int y = 0; y < kHeight; ++y) plane.extend_row_by_copies(y, 3);
  plane.extend_height_by_copies(3);
  return plane;
}

void median7(benchmark::State& state, const Kernels* kernels) {
  Plane in = plane_with_margin();
  Plane out;
  out.resize(kWidth, kHeight);
  std::vector<std::uint8_t> scratch(static_cast<size_t>(7 * in.stride()));
  for (auto _ : state) {
    for (int y = 0; y < kHeight; ++y) {
      const std::uint8_t* rows[7];
      for (int i = 0; i < 7; ++i) rows[i] = in.row(y - 3 + i);
      kernels->median7_row(rows, out.row(y), kWidth, scratch.data(), in.stride());
    }
  }
}

void laplacian5(benchmark::State& state, const Kernels* kernels) {
  Plane in = plane_with_margin();
  Plane out;
  out.resize(kWidth, kHeight);
  for (auto _ : state) {
    for (int y = 0; y < kHeight; ++y) {
      const std::uint8_t* const rows[5] = {in.row(y - 2), in.row(y - 1), in.row(y), in.row(y + 1),
                                           in.row(y + 2)};
      kernels->laplacian5_row(rows, out.row(y), kWidth);
    }
  }
}

void bilateral14(benchmark::State& state, const Kernels* kernels) {
  cv::setNumThreads(1);
  cv::Mat small;
  cv::resize(image(3), small, {kWidth / 2, kHeight / 2});
  BilateralPainter painter;
  for (auto _ : state) {
    cv::Mat work = small.clone();
    painter.paint_with(*kernels, work, {}, 14);
  }
}

void opencv_median7(benchmark::State& state) {
  cv::setNumThreads(1);
  const cv::Mat in = image(1);
  cv::Mat out;
  for (auto _ : state) cv::medianBlur(in, out, 7);
}

void opencv_laplacian5(benchmark::State& state) {
  cv::setNumThreads(1);
  const cv::Mat in = image(1);
  cv::Mat out;
  for (auto _ : state) cv::Laplacian(in, out, CV_8U, 5);
}

void opencv_bilateral14(benchmark::State& state) {
  cv::setNumThreads(1);
  cv::Mat small;
  cv::resize(image(3), small, {kWidth / 2, kHeight / 2});
  cv::Mat other;
  for (auto _ : state) {
    for (int i = 0; i < 14; ++i) {
      cv::bilateralFilter(small, other, 9, 9, 7);
      cv::swap(small, other);
    }
  }
}

void register_all() {
  const auto add = [](const std::string& level, const Kernels* kernels) {
    if (kernels == nullptr) return;
    const auto one = [&](const char* name, void (*run)(benchmark::State&, const Kernels*)) {
      benchmark::RegisterBenchmark((std::string(name) + "/" + level).c_str(), run, kernels)
          ->Unit(benchmark::kMillisecond);
    };
    one("median7", median7);
    one("laplacian5", laplacian5);
    one("bilateral14", bilateral14);
  };
  const SimdLevel best = hardware_simd_level();
  add("baseline", baseline_kernels());
  if (best >= SimdLevel::kSse41) add("SSE4.1", sse41_kernels());
  if (best >= SimdLevel::kAvx2) add("AVX2", avx2_kernels());
  if (best >= SimdLevel::kAvx512) add("AVX-512", avx512_kernels());
  benchmark::RegisterBenchmark("median7/OpenCV", opencv_median7)->Unit(benchmark::kMillisecond);
  benchmark::RegisterBenchmark("laplacian5/OpenCV", opencv_laplacian5)
      ->Unit(benchmark::kMillisecond);
  benchmark::RegisterBenchmark("bilateral14/OpenCV", opencv_bilateral14)
      ->Unit(benchmark::kMillisecond);
}

}  // namespace
}  // namespace tarsier::cartoon

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  tarsier::cartoon::register_all();
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
