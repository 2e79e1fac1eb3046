// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/recognizer.h"

#include "tarsier/core/image.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/face/recognition/features.h"
#include "tarsier/linalg/decompositions.h"
#include "tarsier/linalg/gemm.h"

#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace tarsier::face::recognition {
namespace {

constexpr NameTable<Algorithm, 5> kAlgorithms{"recogniser",
                                              {{
                                                  {Algorithm::kDefault, "default"},
                                                  {Algorithm::kEigen, "eigen"},
                                                  {Algorithm::kFisher, "fisher"},
                                                  {Algorithm::kLbph, "lbph"},
                                                  {Algorithm::kDeep, "deep"},
                                              }}};

std::span<const float> row_of(const Rows& rows, Eigen::Index i) {
  return {rows.data() + i * rows.cols(), static_cast<std::size_t>(rows.cols())};
}

void require_template(const Recognizer& model, std::span<const float> values) {
  TARSIER_REQUIRE(static_cast<int>(values.size()) == model.template_length(),
                  "a template of {} numbers, the model's have {}", values.size(),
                  model.template_length());
}

// Scores of one probe against all templates.
std::vector<double> scores_of(const Recognizer& model, std::span<const float> probe) {
  require_template(model, probe);
  const auto n = static_cast<std::size_t>(model.templates.rows());
  std::vector<double> scores(n);
  if (is_whitened(model.options.algorithm)) {
    std::vector<float> products(n, 0.0F);
    const auto length = static_cast<std::ptrdiff_t>(probe.size());
    const auto dots = [&](std::size_t first, std::size_t last) {
      linalg::gemm_kernels().dots(
          1, static_cast<int>(last - first), static_cast<int>(length), probe.data(), length,
          model.templates.data() + static_cast<std::ptrdiff_t>(first) * length, length,
          products.data() + first, static_cast<std::ptrdiff_t>(n));
    };
    constexpr std::size_t kBlock = 4096;
    if (n <= 2 * kBlock) {
      dots(0, n);
    } else {
      cv::parallel_for_({0, static_cast<int>((n + kBlock - 1) / kBlock)}, [&](const cv::Range& r) {
        dots(static_cast<std::size_t>(r.start) * kBlock,
             std::min(n, static_cast<std::size_t>(r.end) * kBlock));
      });
    }
    std::copy(products.begin(), products.end(), scores.begin());
    return scores;
  }
  for (std::size_t i = 0; i < n; ++i)
    scores[i] = compare(model, probe, row_of(model.templates, static_cast<Eigen::Index>(i)));
  return scores;
}

cv::Mat to_image(const Eigen::RowVectorXf& pixels, cv::Size size) {
  cv::Mat image(size, CV_8UC1);
  for (int i = 0; i < size.area(); ++i)
    image.at<unsigned char>(i / size.width, i % size.width) =
        cv::saturate_cast<unsigned char>(pixels(i));
  return image;
}

void require_pixels(const Recognizer& model) {
  TARSIER_REQUIRE(
      model.options.algorithm == Algorithm::kEigen || model.options.algorithm == Algorithm::kFisher,
      "only eigen and fisher models have images, this is {}", name_of(model.options.algorithm));
}

// The least-squares reconstruction, without rounding. Components need not be orthogonal (fisher).
Eigen::RowVectorXf reconstructed(const Recognizer& model, const std::vector<float>& pixels) {
  const Eigen::Map<const Eigen::RowVectorXf> x(pixels.data(),
                                               static_cast<Eigen::Index>(pixels.size()));
  const Eigen::VectorXd off = (x - model.mean).transpose().cast<double>();
  const Eigen::MatrixXd components = model.components.cast<double>();
  const Eigen::MatrixXd gram = components * components.transpose();
  const Eigen::VectorXd weights = linalg::solve_symmetric(gram, components * off);
  return model.mean + (weights.transpose() * components).cast<float>();
}

}  // namespace

std::string_view name_of(Algorithm algorithm) { return kAlgorithms.name(algorithm); }

Algorithm parse_algorithm(std::string_view name) { return kAlgorithms.parse(name); }

void RecognizerOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(
      (size.width == 0 && size.height == 0) ||
          (size.width >= 8 && size.width <= 1024 && size.height >= 8 && size.height <= 1024),
      "size {}x{}", size.width, size.height);
  lbp.check();
  descriptor.check();
}

int Recognizer::template_length() const {
  return options.algorithm == Algorithm::kLbph ? lbp_length(options.lbp)
                                               : static_cast<int>(components.rows());
}

void Recognizer::refresh() {
  mean_scale.assign(labels.size(), 0.0);
  weights.assign(people.size(), 1.0);
  if (templates.rows() == 0) return;
  const int count = static_cast<int>(labels.size());
  if (is_whitened(options.algorithm)) weights = template_weights(templates, people, count);
  const Eigen::VectorXf factors =
      Eigen::Map<const Eigen::VectorXd>(weights.data(), static_cast<Eigen::Index>(weights.size()))
          .cast<float>();
  const Rows sums = person_sums(factors.asDiagonal() * templates, people, count);
  for (std::size_t p = 0; p < labels.size(); ++p) {
    const double length = sums.row(static_cast<Eigen::Index>(p)).cast<double>().norm();
    mean_scale[p] = length > 1e-9 ? 1 / length : 0;
  }
}

void Recognizer::check() const {
  options.check();
  if (options.algorithm == Algorithm::kLbph) {
    TARSIER_REQUIRE(components.size() == 0 && mean.size() == 0 && options.size.area() > 0,
                    "LBPH has no subspace");
    const int min_side = options.lbp.grid + 2 * options.lbp.radius;
    TARSIER_REQUIRE(options.size.width >= min_side && options.size.height >= min_side,
                    "faces of {}x{} for {} cells of local binary patterns", options.size.width,
                    options.size.height, options.lbp.grid);
  } else {
    const Eigen::Index length = options.algorithm == Algorithm::kDefault
                                    ? descriptor_length(options.descriptor)
                                : options.algorithm == Algorithm::kDeep ? mean.size()
                                                                        : options.size.area();
    TARSIER_REQUIRE(length > 0 && mean.size() == length && components.cols() == length,
                    "{} inputs, mean of {}, components of {}", length, mean.size(),
                    components.cols());
    TARSIER_REQUIRE(components.rows() > 0 && eigenvalues.size() == components.rows(),
                    "{} components, {} values", components.rows(), eigenvalues.size());
    TARSIER_REQUIRE(mean.allFinite() && components.allFinite() && eigenvalues.allFinite(),
                    "numbers of the subspace are not finite");
    TARSIER_REQUIRE(
        !is_whitened(options.algorithm) ||
            (eigenvalues.minCoeff() >= 0 && residual_variance > 0 && residual_variance < 1e30),
        "scatter {}, rest {}", eigenvalues.minCoeff(), residual_variance);
  }
  TARSIER_REQUIRE(templates.rows() == static_cast<Eigen::Index>(people.size()),
                  "{} templates, {} people", templates.rows(), people.size());
  TARSIER_REQUIRE(templates.rows() == 0 || templates.cols() == template_length(),
                  "templates of {} numbers", templates.cols());
  TARSIER_REQUIRE(templates.allFinite(), "numbers of templates are not finite");
  std::vector<bool> seen(labels.size(), false);
  for (const int person : people) {
    TARSIER_REQUIRE(person >= 0 && static_cast<std::size_t>(person) < labels.size(),
                    "template of person {}", person);
    seen[static_cast<std::size_t>(person)] = true;
  }
  TARSIER_REQUIRE(std::find(seen.begin(), seen.end(), false) == seen.end(),
                  "a person without a template");
  TARSIER_REQUIRE(negatives.rows() == static_cast<Eigen::Index>(negative_people.size()) &&
                      (negatives.rows() == 0 || negatives.cols() == template_length()) &&
                      negatives.allFinite(),
                  "{} negatives of {} numbers, {} people", negatives.rows(), negatives.cols(),
                  negative_people.size());
  for (const int person : negative_people)
    TARSIER_REQUIRE(person >= 0 && static_cast<std::size_t>(person) < labels.size(),
                    "negative of person {}", person);
  auto sorted = labels;
  std::sort(sorted.begin(), sorted.end());
  TARSIER_REQUIRE(std::adjacent_find(sorted.begin(), sorted.end()) == sorted.end(),
                  "a label is there twice");
  if (calibration) calibration->check();
}

std::vector<float> template_of(const Recognizer& model, const cv::Mat& face) {
  auto input = features_of(face, model.options, model.network.get());
  if (model.options.algorithm == Algorithm::kLbph) return input;
  return project(model, input);
}

std::vector<float> pooled(const Recognizer& model, std::span<const std::vector<float>> templates) {
  TARSIER_REQUIRE(!templates.empty(), "no templates");
  std::vector<double> sum(static_cast<std::size_t>(model.template_length()), 0.0);
  double lengths = 0;
  for (const auto& one : templates) {
    require_template(model, one);
    double square = 0;
    for (std::size_t i = 0; i < sum.size(); ++i) {
      sum[i] += one[i];
      square += static_cast<double>(one[i]) * one[i];
    }
    lengths += std::sqrt(square);
  }
  double scale = 1 / static_cast<double>(templates.size());
  if (is_whitened(model.options.algorithm)) {
    // Averaging shortens the mean, because differences between the images cancel. Restore the
    // length, so that this does not lower the similarity.
    double square = 0;
    for (const double value : sum) square += value * value;
    scale = square > 0 ? lengths * scale / std::sqrt(square) : 0;
  }
  std::vector<float> out(sum.size());
  for (std::size_t i = 0; i < sum.size(); ++i) out[i] = static_cast<float>(sum[i] * scale);
  return out;
}

double compare(const Recognizer& model, std::span<const float> a, std::span<const float> b) {
  require_template(model, a);
  require_template(model, b);
  switch (model.options.algorithm) {
    case Algorithm::kDefault:
    case Algorithm::kDeep: {
      double sum = 0;
      for (std::size_t i = 0; i < a.size(); ++i) sum += static_cast<double>(a[i]) * b[i];
      return sum;
    }
    case Algorithm::kLbph:
      return -chi_square(a, b);
    case Algorithm::kEigen:
    case Algorithm::kFisher:
      break;
  }
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double difference = static_cast<double>(a[i]) - b[i];
    sum += difference * difference;
  }
  return -std::sqrt(sum);
}

std::vector<PersonScore> identify(const Recognizer& model, const cv::Mat& face) {
  return identify_template(model, template_of(model, face));
}

namespace {

// Max difference between two ways of summing the same score.
constexpr double kScoreTolerance = 1e-5;

// People for whom the probe is at least as similar to a negative as to their best template.
// Templates may be shorter than 1 (the part outside the subspace is missing). Only the angles are
// compared here, so that a face is most similar to itself.
std::vector<bool> excluded_by_negatives(const Recognizer& model, std::span<const float> probe,
                                        const std::vector<PersonScore>& best) {
  std::vector<bool> out(best.size(), false);
  const bool angles = is_whitened(model.options.algorithm);
  const auto scale = [&](const auto& row) {
    return angles ? 1 / std::max(1e-9, static_cast<double>(row.norm())) : 1.0;
  };
  for (std::size_t i = 0; i < model.negative_people.size(); ++i) {
    const auto p = static_cast<std::size_t>(model.negative_people[i]);
    if (out[p] || best[p].nearest < 0) continue;
    const auto row = model.negatives.row(static_cast<Eigen::Index>(i));
    const double score =
        compare(model, probe, {row.data(), static_cast<std::size_t>(row.size())}) * scale(row);
    out[p] = score >= best[p].score * scale(model.templates.row(best[p].nearest)) - kScoreTolerance;
  }
  return out;
}

// Scores of everyone with a template, by rising index.
std::vector<PersonScore> person_scores(const Recognizer& model, std::span<const float> probe) {
  const auto scores = scores_of(model, probe);
  std::vector<PersonScore> out(model.labels.size());
  for (std::size_t p = 0; p < out.size(); ++p)
    out[p] = {static_cast<int>(p), -std::numeric_limits<double>::infinity(), -1};
  const bool weighted = is_whitened(model.options.algorithm);
  TARSIER_REQUIRE(!weighted || model.weights.size() == scores.size(),
                  "the model was changed: refresh() it");
  for (std::size_t i = 0; i < scores.size(); ++i) {
    auto& entry = out[static_cast<std::size_t>(model.people[i])];
    if (weighted && model.weights[i] <= 0) continue;
    if (entry.nearest < 0 || scores[i] > entry.score) {
      entry.score = scores[i];
      entry.nearest = static_cast<int>(i);
    }
  }
  const std::vector<bool> excluded = excluded_by_negatives(model, probe, out);
  if (is_whitened(model.options.algorithm) && model.options.mean_weight > 0) {
    // The cosine to a person's mean is the sum of the cosines divided by the length of the sum.
    TARSIER_REQUIRE(model.mean_scale.size() == out.size(), "the model was changed: refresh() it");
    std::vector<double> totals(out.size(), 0.0);
    for (std::size_t i = 0; i < scores.size(); ++i)
      totals[static_cast<std::size_t>(model.people[i])] += model.weights[i] * scores[i];
    for (std::size_t p = 0; p < out.size(); ++p) {
      const double to_mean = totals[p] * model.mean_scale[p];
      out[p].score =
          (1 - model.options.mean_weight) * out[p].score + model.options.mean_weight * to_mean;
    }
  }
  std::erase_if(out, [&](const PersonScore& entry) {
    return entry.nearest < 0 || excluded[static_cast<std::size_t>(entry.person)];
  });
  return out;
}

}  // namespace

std::optional<PersonScore> best_person(const Recognizer& model, std::span<const float> probe) {
  const auto people = person_scores(model, probe);
  const auto best = std::max_element(
      people.begin(), people.end(),
      [](const PersonScore& a, const PersonScore& b) { return a.score < b.score; });
  if (best == people.end()) return std::nullopt;
  return *best;
}

std::vector<PersonScore> identify_template(const Recognizer& model, std::span<const float> probe) {
  auto out = person_scores(model, probe);
  std::stable_sort(out.begin(), out.end(),
                   [](const PersonScore& a, const PersonScore& b) { return a.score > b.score; });
  return out;
}

int add_face(Recognizer& model, const cv::Mat& face, const std::string& label) {
  const auto values = template_of(model, face);
  auto found = std::find(model.labels.begin(), model.labels.end(), label);
  if (found == model.labels.end()) {
    model.labels.push_back(label);
    found = model.labels.end() - 1;
  }
  const Eigen::Index n = model.templates.rows();
  model.templates.conservativeResize(n + 1, static_cast<Eigen::Index>(values.size()));
  model.templates.row(n) =
      Eigen::Map<const Eigen::RowVectorXf>(values.data(), static_cast<Eigen::Index>(values.size()));
  model.people.push_back(static_cast<int>(found - model.labels.begin()));
  model.refresh();
  return static_cast<int>(n);
}

bool remove_person(Recognizer& model, const std::string& label) {
  const auto found = std::find(model.labels.begin(), model.labels.end(), label);
  if (found == model.labels.end()) return false;
  const int person = static_cast<int>(found - model.labels.begin());
  std::vector<int> people;
  Rows kept(model.templates.rows(), model.templates.cols());
  for (std::size_t i = 0; i < model.people.size(); ++i) {
    if (model.people[i] == person) continue;
    kept.row(static_cast<Eigen::Index>(people.size())) =
        model.templates.row(static_cast<Eigen::Index>(i));
    people.push_back(model.people[i] > person ? model.people[i] - 1 : model.people[i]);
  }
  model.templates = kept.topRows(static_cast<Eigen::Index>(people.size()));
  model.people = std::move(people);
  model.labels.erase(found);
  std::vector<int> negative_people;
  Rows negatives(model.negatives.rows(), model.negatives.cols());
  for (std::size_t i = 0; i < model.negative_people.size(); ++i) {
    const int of = model.negative_people[i];
    if (of == person) continue;
    negatives.row(static_cast<Eigen::Index>(negative_people.size())) =
        model.negatives.row(static_cast<Eigen::Index>(i));
    negative_people.push_back(of > person ? of - 1 : of);
  }
  model.negatives = negatives.topRows(static_cast<Eigen::Index>(negative_people.size())).eval();
  model.negative_people = std::move(negative_people);
  model.refresh();
  return true;
}

cv::Mat mean_face(const Recognizer& model) {
  require_pixels(model);
  return to_image(model.mean, model.options.size);
}

cv::Mat component_image(const Recognizer& model, int i) {
  require_pixels(model);
  TARSIER_REQUIRE(i >= 0 && i < model.components.rows(), "component {} of {}", i,
                  model.components.rows());
  const Eigen::RowVectorXf row = model.components.row(i);
  const float low = row.minCoeff();
  const float high = row.maxCoeff();
  const float scale = high > low ? 255 / (high - low) : 0;
  return to_image((row.array() - low) * scale, model.options.size);
}

cv::Mat reconstruction(const Recognizer& model, const cv::Mat& face) {
  require_pixels(model);
  return to_image(reconstructed(model, features_of(face, model.options)), model.options.size);
}

double reconstruction_error(const Recognizer& model, const cv::Mat& face) {
  require_pixels(model);
  const auto pixels = features_of(face, model.options);
  const Eigen::Map<const Eigen::RowVectorXf> x(pixels.data(),
                                               static_cast<Eigen::Index>(pixels.size()));
  const Eigen::RowVectorXf back = reconstructed(model, pixels);
  return static_cast<double>((back - x).norm()) / static_cast<double>(x.size());
}

}  // namespace tarsier::face::recognition
