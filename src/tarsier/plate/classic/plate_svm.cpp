// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/plate_svm.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/linalg/model_fields.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/classic/xml_matrix.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numeric>

namespace tarsier::plate {
namespace {

namespace fs = std::filesystem;
constexpr int kPlateSvmVersion = 1;
constexpr int kFolds = 5;

std::vector<float> projected(const std::vector<float>& values, const std::vector<float>& mean,
                             const cv::Mat& basis) {
  std::vector<float> result(static_cast<std::size_t>(basis.rows));
  for (int c = 0; c < basis.rows; ++c) {
    const auto* axis = basis.ptr<float>(c);
    double sum = 0;
    for (std::size_t k = 0; k < values.size(); ++k)
      sum += static_cast<double>(axis[k]) * static_cast<double>(values[k] - mean[k]);
    result[static_cast<std::size_t>(c)] = static_cast<float>(sum);
  }
  return result;
}

cv::Mat rows_of(const PlateSet& set, const std::vector<int>& indices, PlateFeatures features) {
  cv::Mat rows;
  for (const int i : indices) {
    const std::vector<float> values =
        plate_features(set.candidates[static_cast<std::size_t>(i)], features);
    rows.push_back(cv::Mat(values, true).reshape(1, 1));
  }
  return rows;
}

PlateSvm train_on(const PlateSet& set, const std::vector<int>& indices,
                  const PlateSvmOptions& options, const Rng& rng) {
  PlateSvm svm;
  svm.features = options.features;
  cv::Mat rows = rows_of(set, indices, options.features);
  std::vector<int> labels;
  labels.reserve(indices.size());
  for (const int i : indices) labels.push_back(set.labels[static_cast<std::size_t>(i)]);
  if (options.features == PlateFeatures::kPca) {
    const cv::PCA pca(rows, cv::Mat(), cv::PCA::DATA_AS_ROW,
                      std::min(options.components, rows.rows - 1));
    svm.mean.assign(pca.mean.ptr<float>(), pca.mean.ptr<float>() + pca.mean.cols);
    svm.basis = pca.eigenvectors.clone();
    rows = pca.project(rows);
  }
  svm.model = train_linear_svm(rows, labels, options.cost, options.iterations, rng);
  return svm;
}

// Calls visit(index of the example, margin by an SVM that was not trained on it).
template <typename Visit>
void cross_validate(const PlateSet& set, const PlateSvmOptions& options, Rng rng,
                    const Visit& visit) {
  std::vector<int> order(set.candidates.size());
  std::iota(order.begin(), order.end(), 0);
  for (std::size_t i = order.size(); i > 1; --i)
    std::swap(order[i - 1],
              order[static_cast<std::size_t>(rng.integer(0, static_cast<int>(i) - 1))]);
  for (int fold = 0; fold < kFolds; ++fold) {
    std::vector<int> train_indices;
    for (std::size_t i = 0; i < order.size(); ++i)
      if (static_cast<int>(i) % kFolds != fold) train_indices.push_back(order[i]);
    const PlateSvm svm =
        train_on(set, train_indices, options, rng.fork(static_cast<std::uint64_t>(fold)));
    for (std::size_t i = 0; i < order.size(); ++i)
      if (static_cast<int>(i) % kFolds == fold)
        visit(order[i], svm.margin(set.candidates[static_cast<std::size_t>(order[i])]));
  }
}

void check_set(const PlateSet& set) {
  const auto plates = std::count(set.labels.begin(), set.labels.end(), 1);
  TARSIER_REQUIRE(
      plates >= kFolds && static_cast<std::ptrdiff_t>(set.labels.size()) - plates >= kFolds,
      "{} plates and {} others are too few to learn from", plates,
      static_cast<std::ptrdiff_t>(set.labels.size()) - plates);
}

}  // namespace

PlateSet read_plate_set(const std::string& path) {
  PlateSet set;
  std::error_code error;
  if (fs::is_directory(path, error)) {
    for (const auto& [name, label] : {std::pair{"plate", 1}, std::pair{"no-plate", -1}}) {
      std::vector<fs::path> files;
      for (const fs::directory_entry& entry : fs::directory_iterator(fs::path(path) / name, error))
        files.push_back(entry.path());
      if (error)
        throw InputError(path,
                         fmt::format("the folder {} cannot be read: {}", name, error.message()));
      std::sort(files.begin(), files.end());
      for (const fs::path& file : files) {
        cv::Mat gray = read_gray_image(file.string());
        if (gray.size() != kPlateSize) {
          cv::resize(gray, gray, kPlateSize, 0, 0, cv::INTER_AREA);
          cv::equalizeHist(gray, gray);
        }
        set.candidates.push_back(gray);
        set.labels.push_back(label);
      }
    }
    return set;
  }
  const auto matrices = read_xml_matrices(path);
  const cv::Mat& pixels = matrix_named(matrices, "TrainingData", path);
  const cv::Mat& classes = matrix_named(matrices, "classes", path);
  if (pixels.cols != kPlateSize.area() || pixels.rows != static_cast<int>(classes.total())) {
    throw InputError(path, fmt::format("TrainingData is {}x{}, classes has {}: 4752 columns and as "
                                       "many rows are expected",
                                       pixels.rows, pixels.cols, classes.total()));
  }
  for (int i = 0; i < pixels.rows; ++i) {
    cv::Mat candidate;
    pixels.row(i).reshape(1, kPlateSize.height).convertTo(candidate, CV_8U);
    set.candidates.push_back(candidate);
    set.labels.push_back(classes.ptr<float>()[i] > 0.5F ? 1 : -1);
  }
  return set;
}

double PlateSvm::margin(const cv::Mat& candidate) const {
  const std::vector<float> values = plate_features(candidate, features);
  if (features != PlateFeatures::kPca) return model.margin(values.data());
  return model.margin(projected(values, mean, basis).data());
}

PlateSvm train_plate_svm(const PlateSet& set, const PlateSvmOptions& options, Rng rng) {
  options.check();
  check_set(set);
  std::vector<double> margins;
  std::vector<int> labels;
  cross_validate(set, options, rng.fork(1), [&](int i, double margin) {
    margins.push_back(margin);
    labels.push_back(set.labels[static_cast<std::size_t>(i)]);
  });
  std::vector<int> all(set.candidates.size());
  std::iota(all.begin(), all.end(), 0);
  PlateSvm svm = train_on(set, all, options, rng.fork(2));
  svm.platt = fit_platt_scaling(margins, labels);
  return svm;
}

double cross_validated_error(const PlateSet& set, const PlateSvmOptions& options, Rng rng) {
  options.check();
  check_set(set);
  int wrong = 0;
  cross_validate(set, options, rng, [&](int i, double margin) {
    wrong += (margin > 0) != (set.labels[static_cast<std::size_t>(i)] > 0);
  });
  return static_cast<double>(wrong) / static_cast<double>(set.candidates.size());
}

namespace {

void list_svm(linalg::ModelFields& file, PlateSvm& svm) {
  file.named("features", svm.features, parse_plate_features);
  auto width = static_cast<std::int64_t>(
      plate_features(cv::Mat(kPlateSize, CV_8UC1, cv::Scalar(0)), svm.features).size());
  if (svm.features == PlateFeatures::kPca) {
    file.list<float>("mean", svm.mean, width);
    std::vector<float> basis;
    if (!svm.basis.empty()) basis.assign(svm.basis.begin<float>(), svm.basis.end<float>());
    file.rows("basis", basis, -1, width);
    const std::int64_t components = static_cast<std::int64_t>(basis.size()) / width;
    file.require(components >= 1 && components <= 500, "basis: 1 to 500 rows are expected");
    if (file.reads()) svm.basis = cv::Mat(basis, true).reshape(1, static_cast<int>(components));
    width = components;
  }
  file.list<float>("weights", svm.model.weights, width);
  file.number("bias", svm.model.bias, -1e9, 1e9);
  std::array<double, 2> platt{svm.platt.a, svm.platt.b};
  file.other("chance", platt, [](const nlohmann::json& object, const std::string& path) {
    const nlohmann::json& value = member(object, "chance", path);
    if (!value.is_array() || value.size() != 2 || !value[0].is_number() || !value[1].is_number())
      throw ModelError(path, "chance: two numbers are expected");
    return value.get<std::array<double, 2>>();
  });
  svm.platt = {platt[0], platt[1]};
}

}  // namespace

void write_plate_svm(const std::string& path, const PlateSvm& svm,
                     const nlohmann::json& provenance) {
  write_archive(path, {"plate-svm", kPlateSvmVersion, provenance, linalg::written(svm, list_svm)});
}

PlateSvm read_plate_svm(const std::string& path) {
  return linalg::read_fields<PlateSvm>(read_archive(path, "plate-svm", kPlateSvmVersion).payload,
                                       path, list_svm);
}

}  // namespace tarsier::plate
