// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/folds.h"

#include "tarsier/core/stop.h"
#include "tarsier/face/recognition/features.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace tarsier::face::recognition {
namespace {

constexpr int kFolds = 8;
constexpr double kNoScore = -std::numeric_limits<double>::infinity();

// The score of each person from scores of single images, as in identify().
std::vector<double> person_scores(const std::vector<double>& scores, const std::vector<int>& people,
                                  const std::vector<double>& weights,
                                  const std::vector<double>& mean_scale, double mean_weight) {
  std::vector<double> best(mean_scale.size(), kNoScore);
  std::vector<double> total(mean_scale.size(), 0.0);
  for (std::size_t i = 0; i < scores.size(); ++i) {
    if (weights[i] <= 0) continue;
    const auto p = static_cast<std::size_t>(people[i]);
    best[p] = std::max(best[p], scores[i]);
    total[p] += weights[i] * scores[i];
  }
  for (std::size_t p = 0; p < best.size(); ++p)
    if (best[p] > kNoScore)
      best[p] = (1 - mean_weight) * best[p] + mean_weight * total[p] * mean_scale[p];
  return best;
}

}  // namespace

Whitening CrossValidation::whitener(const Eigen::MatrixXd& some,
                                    const std::vector<bool>& held_out) const {
  std::vector<Eigen::Index> training_rows;
  std::vector<int> labels;
  for (std::size_t i = 0; i < people.size(); ++i) {
    if (!held_out.empty() && held_out[i]) continue;
    for (int m = 0; m < copies; ++m) {
      training_rows.push_back(static_cast<Eigen::Index>(i) * copies + m);
      labels.push_back(people[i]);
    }
  }
  Eigen::MatrixXd scatter = within_scatter(some(training_rows, Eigen::all), labels, person_count);
  if (prior_within.size() > 0) {
    // The copies of an image carry less information than another image: each image counts once.
    const auto training_people =
        static_cast<double>(std::set<int>(labels.begin(), labels.end()).size());
    const double images = static_cast<double>(training_rows.size()) / copies;
    const double own =
        std::max(0.0, images - training_people) + 0.2 * images * (copies > 1 ? 1 : 0);
    scatter = (own * scatter + prior_within_weight * prior_within) / (own + prior_within_weight);
  }
  return whitening(scatter, ridge);
}

Rows CrossValidation::templates(const std::vector<bool>& held_out) const {
  const auto faces = static_cast<Eigen::Index>(people.size());
  std::vector<Eigen::Index> training_rows;
  std::vector<int> labels;
  std::vector<int> enrolled_index(static_cast<std::size_t>(person_count), -1);
  int enrolled = 0;
  Eigen::RowVectorXd mean = Eigen::RowVectorXd::Zero(coefficients.cols());
  for (std::size_t i = 0; i < people.size(); ++i) {
    if (held_out[i]) continue;
    const Eigen::Index row = static_cast<Eigen::Index>(i) * copies;
    training_rows.push_back(row);
    int& index = enrolled_index[static_cast<std::size_t>(people[i])];
    if (index < 0) index = enrolled++;
    labels.push_back(index);
    mean += coefficients.row(row);
  }
  const auto count = static_cast<double>(training_rows.size());
  mean /= count;
  const double own = enrolled > 1 ? enrolled : 0;  // as in training
  if (background.size() > 0)
    mean = (own * mean + background_weight * background) / (own + background_weight);
  else if (algorithm == Algorithm::kDefault && enrolled < 2)
    mean.setZero();
  const Eigen::MatrixXd centred = coefficients.rowwise() - mean;

  std::vector<Eigen::Index> rows;
  for (const auto row : basis)
    if (!held_out[row / static_cast<std::size_t>(copies)])
      rows.push_back(static_cast<Eigen::Index>(row));
  int limit = max_components;
  if (algorithm == Algorithm::kFisher)
    limit = std::max(1, static_cast<int>(training_rows.size()) - enrolled);
  const Eigen::RowVectorXf none = Eigen::RowVectorXf::Zero(centred.cols());
  Eigen::MatrixXd reduced = centred;
  if (prior_within.size() == 0) {
    const Pca pca = principal_components(centred(rows, Eigen::all).cast<float>(), limit, &none);
    reduced = centred * pca.components.transpose().cast<double>();
  }
  Whitening white;
  if (algorithm == Algorithm::kDefault) {
    white = whitener(reduced, held_out);
    reduced *= white.directions;
  }
  std::vector<Eigen::Index> upright(people.size());
  for (Eigen::Index i = 0; i < faces; ++i) upright[static_cast<std::size_t>(i)] = i * copies;
  if (algorithm == Algorithm::kFisher) {
    const Eigen::MatrixXd directions =
        enrolled > 1 && static_cast<int>(training_rows.size()) > enrolled
            ? linear_discriminants(reduced(training_rows, Eigen::all), labels, enrolled)
            : Eigen::MatrixXd::Zero(reduced.cols(), 0);
    reduced = (reduced * directions).eval();
  }
  Rows out = reduced(upright, Eigen::all).cast<float>();
  if (algorithm == Algorithm::kDefault) {
    Eigen::VectorXd square = centred(upright, Eigen::all).rowwise().squaredNorm();
    if (residual_squared.size() > 0) square += residual_squared;
    scale_rows(out, square, white.scatter, white.residual_variance);
  }
  return out;
}

int CrossValidation::count() const {
  return person_count > 1 ? std::min(kFolds, std::max(person_count, 2)) : 2;
}

void CrossValidation::score(int fold, ScoreSample& sample) const {
  const std::size_t faces = people.size();
  const auto images = static_cast<Eigen::Index>(faces);
  std::vector<int> image_index(faces);  // index of an image among its person's images
  std::vector<int> image_count(static_cast<std::size_t>(person_count), 0);
  for (std::size_t i = 0; i < faces; ++i)
    image_index[i] = image_count[static_cast<std::size_t>(people[i])]++;
  const int folds = count();
  std::vector<bool> held_out(faces);
  std::vector<bool> in_gallery(faces);
  std::vector<bool> impostor(faces);
  for (std::size_t i = 0; i < faces; ++i) {
    const auto p = static_cast<std::size_t>(people[i]);
    impostor[i] = person_count > 1 && people[i] % folds == fold;
    // A person with two or more images keeps at least one in every fold.
    held_out[i] =
        impostor[i] || (image_count[p] > 1 && (image_index[i] + people[i]) % folds == fold);
    in_gallery[i] = !held_out[i];
  }
  std::vector<bool> enrolled(static_cast<std::size_t>(person_count), false);
  for (std::size_t i = 0; i < faces; ++i)
    if (in_gallery[i]) enrolled[static_cast<std::size_t>(people[i])] = true;
  const auto known = static_cast<int>(std::count(enrolled.begin(), enrolled.end(), true));
  if (known == 0) return;
  sample.gallery += static_cast<double>(known) / folds;

  const Rows templates = this->templates(held_out);
  if (templates.cols() == 0) return;
  // Only the held-out images are compared.
  std::vector<Eigen::Index> probes;
  for (std::size_t i = 0; i < faces; ++i)
    if (held_out[i]) probes.push_back(static_cast<Eigen::Index>(i));
  Rows similarities = products(templates(probes, Eigen::all), templates);
  if (algorithm != Algorithm::kDefault) {
    const Eigen::VectorXf squares = templates.rowwise().squaredNorm();
    for (Eigen::Index i = 0; i < similarities.rows(); ++i)
      for (Eigen::Index j = 0; j < images; ++j)
        similarities(i, j) =
            -std::sqrt(std::max(0.0F, squares(probes[static_cast<std::size_t>(i)]) + squares(j) -
                                          2 * similarities(i, j)));
  }
  Rows gallery_rows = templates;
  for (std::size_t i = 0; i < faces; ++i)
    if (!in_gallery[i]) gallery_rows.row(static_cast<Eigen::Index>(i)).setZero();
  std::vector<double> weights(faces, 1.0);
  if (is_whitened(algorithm)) weights = template_weights(gallery_rows, people, person_count);
  for (std::size_t i = 0; i < faces; ++i) {
    if (!in_gallery[i]) weights[i] = 0;
    gallery_rows.row(static_cast<Eigen::Index>(i)) *= static_cast<float>(weights[i]);
  }
  const Rows sums = person_sums(gallery_rows, people, person_count);
  std::vector<double> mean_scale(static_cast<std::size_t>(person_count), 0.0);
  for (std::size_t p = 0; p < mean_scale.size(); ++p) {
    const double length = sums.row(static_cast<Eigen::Index>(p)).cast<double>().norm();
    mean_scale[p] = length > 1e-9 ? 1 / length : 0;
  }
  for (std::size_t k = 0; k < probes.size(); ++k) {
    const auto i = static_cast<std::size_t>(probes[k]);
    const float* row = similarities.data() + static_cast<Eigen::Index>(k) * images;
    const std::vector<double> scores(row, row + images);
    const auto by_person = person_scores(scores, people, weights, mean_scale, mean_weight);
    if (impostor[i]) {
      sample.impostor.push_back(*std::max_element(by_person.begin(), by_person.end()));
      sample.impostor_person.push_back(people[i]);
    } else if (enrolled[static_cast<std::size_t>(people[i])]) {
      sample.genuine.push_back(by_person[static_cast<std::size_t>(people[i])]);
    }
  }
}

ScoreSample CrossValidation::scores(const std::stop_token& stop) const {
  ScoreSample sample;
  sample.gallery = 0;
  for (int fold = 0; fold < count(); ++fold) {
    throw_if_stopped(stop);
    score(fold, sample);
  }
  sample.gallery = std::max(1.0, sample.gallery);
  return sample;
}

ScoreSample leave_one_out_scores(const Recognizer& model, const std::stop_token& stop) {
  ScoreSample sample;
  const Eigen::Index n = model.templates.rows();
  const auto width = static_cast<std::size_t>(model.templates.cols());
  std::vector<double> own(static_cast<std::size_t>(n), kNoScore);
  std::vector<double> other(static_cast<std::size_t>(n), kNoScore);
  for (Eigen::Index i = 0; i < n; ++i) {
    throw_if_stopped(stop);
    const auto a = static_cast<std::size_t>(i);
    for (Eigen::Index j = i + 1; j < n; ++j) {
      const auto b = static_cast<std::size_t>(j);
      const double score =
          compare(model, {model.templates.data() + i * model.templates.cols(), width},
                  {model.templates.data() + j * model.templates.cols(), width});
      auto& best = model.people[a] == model.people[b] ? own : other;
      best[a] = std::max(best[a], score);
      best[b] = std::max(best[b], score);
    }
  }
  for (std::size_t i = 0; i < own.size(); ++i) {
    if (own[i] > kNoScore) sample.genuine.push_back(own[i]);
    if (other[i] > kNoScore) {
      sample.impostor.push_back(other[i]);
      sample.impostor_person.push_back(model.people[i]);
    }
  }
  sample.gallery = std::max(1.0, static_cast<double>(model.labels.size()) - 1);
  return sample;
}

}  // namespace tarsier::face::recognition
