// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/training.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/classical_training.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/face/recognition/features.h"
#include "tarsier/face/recognition/folds.h"
#include "tarsier/face/recognition/gallery_prior.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

namespace tarsier::face::recognition {
namespace {

constexpr int kMaxComponents = 256;  // of the default recogniser, if not set
// Rows of the largest matrix whose eigenvectors training computes.
constexpr std::size_t kBasisRows = 480;
// Prior of the default recogniser's scores if nothing else is known.
constexpr CalibrationPrior kPrior{0, 0.15, 0.5, 2};

struct Perturbation {
  double dx, dy;  // px, for a face 64 px wide
  double degrees, growth;
};
constexpr std::array<Perturbation, 7> kPerturbations{{{0, 0, 0, 0},
                                                      {1.5, 0, 0, 0},
                                                      {-1.5, 0, 0, 0},
                                                      {0, 1.5, 0, 0},
                                                      {0, -1.5, 0, 0},
                                                      {0, 0, 3, 0.03},
                                                      {0, 0, -3, -0.03}}};

// The rows of one face: unchanged first, then the moved copies.
void describe_face(const cv::Mat& face, const RecognizerOptions& options,
                   const DeepNetwork* network, std::size_t copies, Eigen::Ref<Rows> rows) {
  const auto put = [&](std::size_t row, const std::vector<float>& values) {
    rows.row(static_cast<Eigen::Index>(row)) = Eigen::Map<const Eigen::RowVectorXf>(
        values.data(), static_cast<Eigen::Index>(values.size()));
  };
  if (copies == 1) {
    put(0, features_of(face, options, network));
    return;
  }
  cv::Mat sized;
  cv::resize(face, sized, options.descriptor.size, 0, 0,
             face.cols > options.descriptor.size.width ? cv::INTER_AREA : cv::INTER_LINEAR);
  const double px = options.variants * options.descriptor.size.width / 64;
  for (std::size_t m = 0; m < copies; ++m) {
    const Perturbation& perturbation = kPerturbations[m];
    put(m, features_of(m == 0 ? sized
                              : transformed_face(sized, perturbation.dx * px, perturbation.dy * px,
                                                 perturbation.degrees * options.variants,
                                                 1 + perturbation.growth * options.variants),
                       options));
  }
}

int feature_count(const RecognizerOptions& options, const DeepNetwork* network) {
  switch (options.algorithm) {
    case Algorithm::kDefault:
      return descriptor_length(options.descriptor);
    case Algorithm::kDeep:
      return network->outputs();
    case Algorithm::kLbph:
      return lbp_length(options.lbp);
    case Algorithm::kEigen:
    case Algorithm::kFisher:
      break;
  }
  return options.size.area();
}

Rows rows_at(const Rows& rows, const std::vector<std::size_t>& indices) {
  Rows out(static_cast<Eigen::Index>(indices.size()), rows.cols());
  for (std::size_t i = 0; i < indices.size(); ++i)
    out.row(static_cast<Eigen::Index>(i)) = rows.row(static_cast<Eigen::Index>(indices[i]));
  return out;
}

// Rows from which the principal components are computed: every unchanged face, then moved copies as
// far as they fit. Of very many faces, an evenly chosen subset.
std::vector<std::size_t> basis_rows(std::size_t faces, std::size_t copies) {
  std::vector<std::size_t> rows;
  if (faces > kBasisRows) {
    for (std::size_t i = 0; i < kBasisRows; ++i) rows.push_back(i * faces / kBasisRows * copies);
    return rows;
  }
  for (std::size_t m = 0; m < copies && (m + 1) * faces <= std::max(kBasisRows, faces); ++m)
    for (std::size_t i = 0; i < faces; ++i) rows.push_back(i * copies + m);
  return rows;
}

// Sets the whitened directions of the model from the folds' data.
void whiten(Recognizer& model, const CrossValidation& validation, const Rows& components,
            bool has_background_basis) {
  const Eigen::Index kept =
      has_background_basis ? components.rows()
                           : std::min<Eigen::Index>(validation.max_components, components.rows());
  const Whitening white = validation.whitener(validation.coefficients.leftCols(kept), {});
  model.components =
      (white.directions.transpose() * components.topRows(kept).cast<double>()).cast<float>();
  model.eigenvalues = white.scatter;
  model.residual_variance = white.residual_variance;
}

void check_background(const Background& background, Eigen::Index length) {
  background.check();
  TARSIER_REQUIRE(background.mean.size() == length,
                  "a background of {} numbers for descriptors of {}", background.mean.size(),
                  length);
}

void require_network(const Background* background) {
  if (background == nullptr || !background->network)
    throw std::invalid_argument("deep templates need their network and its background");
  check_background(*background, background->network->outputs());
  TARSIER_REQUIRE(background->basis.rows() > 0, "a background of a mean alone");
}

}  // namespace

std::vector<std::size_t> training_subset(const std::vector<int>& people, int max) {
  TARSIER_REQUIRE(max >= 1, "at most {} faces", max);
  std::vector<std::size_t> out;
  if (people.size() <= static_cast<std::size_t>(max)) {
    out.resize(people.size());
    std::iota(out.begin(), out.end(), std::size_t{0});
    return out;
  }
  constexpr std::size_t kImagesPerPerson = 4;
  const auto most = static_cast<std::size_t>(max);
  std::vector<std::vector<std::size_t>> of_person;
  for (std::size_t i = 0; i < people.size(); ++i) {
    TARSIER_REQUIRE(people[i] >= 0, "person {}", people[i]);
    const auto p = static_cast<std::size_t>(people[i]);
    if (p >= of_person.size()) of_person.resize(p + 1);
    of_person[p].push_back(i);
  }
  const std::size_t count = of_person.size();
  // With few people, use more images of each. Use as many people as fit with their images.
  const std::size_t images_per_person =
      std::max(kImagesPerPerson, most / std::max<std::size_t>(1, count));
  std::size_t total_images = 0;
  for (const auto& faces : of_person) total_images += std::min(images_per_person, faces.size());
  const std::size_t chosen =
      total_images <= most ? count : std::max<std::size_t>(1, count * most / total_images);
  for (std::size_t k = 0; k < chosen; ++k) {
    const auto& faces = of_person[k * count / chosen];
    const std::size_t used = std::min(images_per_person, faces.size());
    for (std::size_t j = 0; j < used; ++j) out.push_back(faces[j * faces.size() / used]);
  }
  std::sort(out.begin(), out.end());
  if (out.size() > most) out.resize(most);
  return out;
}

struct Training::Impl {
  enum class Stage {
    kDescribe,
    kLearn,
    kProject,
    kWhiten,
    kPrior,
    kFolds,
    kRemainingTemplates,
    kDone
  };

  std::vector<cv::Mat> faces;
  std::vector<std::string> labels;  // people
  std::vector<int> people;          // of all faces
  const Background* background = nullptr;
  Recognizer model;
  std::vector<std::size_t> training_faces;  // indices of faces
  std::size_t copies = 1;
  bool has_background_basis = false;
  Stage stage = Stage::kDescribe;
  std::size_t at = 0;  // progress within the stage
  double work = 0;
  Rows rows;         // of the training faces; default: minus the mean after kLearn
  Rows coordinates;  // instead of faces; or empty
  Rows components;   // default: principal, orthonormal
  CrossValidation validation;
  CalibrationPrior prior = kPrior;
  ScoreSample sample;

  void number_people(const std::vector<std::string>& names) {
    std::map<std::string, int> index;
    for (const auto& name : names) {
      const auto [entry, inserted] = index.try_emplace(name, static_cast<int>(index.size()));
      if (inserted) labels.push_back(name);
      people.push_back(entry->second);
    }
  }
  [[nodiscard]] bool classical() const { return !is_whitened(model.options.algorithm); }
  [[nodiscard]] int training_people() const { return static_cast<int>(model.labels.size()); }
  void next(Stage following) {
    stage = following;
    at = 0;
  }

  void describe(Progress& progress, const std::stop_token& stop);
  void learn_classical(const std::stop_token& stop);
  void learn();
  void learn_coordinates(Progress& progress);
  void project();
  void whiten_all();
  void compute_prior();
  void fold();
  void make_remaining_templates();
  void finish();
};

void Training::Impl::describe(Progress& progress, const std::stop_token& stop) {
  constexpr std::size_t kChunk = 16;  // faces between checks of the stop token
  if (at == 0) {
    progress.begin("describing", static_cast<std::int64_t>(training_faces.size()), "faces");
    rows.resize(static_cast<Eigen::Index>(training_faces.size() * copies),
                feature_count(model.options, model.network.get()));
  }
  const std::size_t last = std::min(training_faces.size(), at + kChunk);
  cv::parallel_for_({static_cast<int>(at), static_cast<int>(last)}, [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i)
      describe_face(faces[training_faces[static_cast<std::size_t>(i)]], model.options,
                    model.network.get(), copies,
                    rows.middleRows(static_cast<Eigen::Index>(i) * static_cast<int>(copies),
                                    static_cast<Eigen::Index>(copies)));
  });
  progress.advance(static_cast<std::int64_t>(last - at));
  work = static_cast<double>((last - at) * copies);
  at = last;
  if (at < training_faces.size()) return;
  progress.end();
  throw_if_stopped(stop);
  next(Stage::kLearn);
  if (model.options.algorithm == Algorithm::kDeep) {
    coordinates = coordinates_of_rows(*background, rows);
    return;
  }
  progress.begin("training", 0, "steps");
}

void Training::Impl::learn_classical(const std::stop_token& stop) {
  work = 1e-7 * std::pow(static_cast<double>(rows.rows()), 3) + 50;
  train_classical(model, rows, stop);
  next(Stage::kRemainingTemplates);
}

void Training::Impl::learn() {
  std::vector<std::size_t> upright(training_faces.size());
  for (std::size_t i = 0; i < upright.size(); ++i) upright[i] = i * copies;
  // With one person alone, the mean would be that person, so none is subtracted.
  Eigen::RowVectorXf mean =
      training_people() > 1 || background != nullptr
          ? Eigen::RowVectorXf(rows_at(rows, upright).cast<double>().colwise().mean().cast<float>())
          : Eigen::RowVectorXf::Zero(rows.cols());
  if (background != nullptr) check_background(*background, rows.cols());
  mean = mean_with_background(mean, training_people(), background);
  has_background_basis = background != nullptr && background->basis.rows() > 0;
  validation.basis = basis_rows(training_faces.size(), copies);
  if (has_background_basis) {
    components =
        extended_basis(background->basis, rows_at(rows, validation.basis).rowwise() - mean);
  } else {
    components = principal_components(rows_at(rows, validation.basis), 0, &mean).components;
  }
  TARSIER_REQUIRE(components.rows() > 0, "the faces are flat or all the same");
  rows.rowwise() -= mean;
  model.mean = mean;
  validation.coefficients.resize(rows.rows(), components.rows());
  validation.people = model.people;
  validation.person_count = training_people();
  validation.copies = static_cast<int>(copies);
  validation.max_components =
      model.options.components > 0 ? model.options.components : kMaxComponents;
  validation.ridge = model.options.ridge;
  validation.mean_weight = model.options.mean_weight;
  if (has_background_basis) {
    validation.prior_within =
        prior_within_scatter(*background, components.rows() - background->basis.rows());
    validation.prior_within_weight = background->within_weight;
  }
  work = 20 + 1e-6 * std::pow(static_cast<double>(validation.basis.size()), 3);
  next(Stage::kProject);
}

void Training::Impl::learn_coordinates(Progress& progress) {
  progress.begin("training", 0, "steps");
  const Eigen::Index m = background->basis.rows();
  // The mean of the gallery, projected on the directions.
  const Eigen::RowVectorXf own =
      coordinates.leftCols(m).cast<double>().colwise().mean().cast<float>();
  model.mean = mean_with_background(background->mean + own * background->basis, training_people(),
                                    background);
  const Rows shift = products(Rows(model.mean - background->mean), background->basis);
  validation.coefficients =
      (coordinates.leftCols(m).rowwise() - Eigen::RowVectorXf(shift.row(0))).cast<double>();
  validation.residual_squared = coordinates.col(m).cast<double>().cwiseMax(0);
  validation.people = model.people;
  validation.person_count = training_people();
  validation.max_components = kMaxComponents;
  validation.ridge = model.options.ridge;
  validation.mean_weight = model.options.mean_weight;
  validation.prior_within = prior_within_scatter(*background, 0);
  validation.prior_within_weight = background->within_weight;
  next(Stage::kWhiten);
}

void Training::Impl::project() {
  constexpr std::size_t kChunk = 512;
  const auto first = static_cast<Eigen::Index>(at);
  const Eigen::Index count = std::min<Eigen::Index>(kChunk, rows.rows() - first);
  validation.coefficients.middleRows(first, count) =
      products(rows.middleRows(first, count), components).cast<double>();
  work = 2e-7 * static_cast<double>(count * rows.cols() * components.rows());
  at += static_cast<std::size_t>(count);
  if (at == static_cast<std::size_t>(rows.rows())) next(Stage::kWhiten);
}

void Training::Impl::whiten_all() {
  work = 5e-7 *
         static_cast<double>(validation.coefficients.rows() + validation.coefficients.cols()) *
         static_cast<double>(validation.coefficients.cols() * validation.coefficients.cols());
  if (coordinates.size() > 0) {
    whiten(model, validation, background->basis, true);
    model.templates = templates_of_coordinates(model, *background, coordinates);
    validation.background =
        products(Rows(background->mean - model.mean), background->basis).row(0).cast<double>();
    validation.background_weight = background->weight;
    next(Stage::kPrior);
    return;
  }
  whiten(model, validation, components, has_background_basis);
  std::vector<std::size_t> upright(training_faces.size());
  for (std::size_t i = 0; i < upright.size(); ++i) upright[i] = i * copies;
  const Rows own = rows_at(rows, upright);
  model.templates = products(own, model.components);
  scale_rows(model.templates, own.cast<double>().rowwise().squaredNorm(), model.eigenvalues,
             model.residual_variance);
  if (background != nullptr) {
    validation.background =
        (components * (background->mean - model.mean).transpose()).transpose().cast<double>();
    validation.background_weight = background->weight;
  }
  // One person without a background: there are no impostor scores and no prior.
  next(training_people() < 2 && background == nullptr ? Stage::kRemainingTemplates : Stage::kPrior);
}

void Training::Impl::compute_prior() {
  prior = background != nullptr ? background->prior : kPrior;
  if (has_background_basis) {
    model.refresh();
    prior = impostor_prior(model, *background);
  }
  work = 20 + 1e-4 * static_cast<double>(model.templates.size());
  sample.gallery = 0;
  next(Stage::kFolds);
}

void Training::Impl::fold() {
  validation.score(static_cast<int>(at), sample);
  work = 5e-7 *
         static_cast<double>(validation.coefficients.rows() + validation.coefficients.cols()) *
         static_cast<double>(validation.coefficients.cols() * validation.coefficients.cols());
  if (static_cast<int>(++at) < validation.count()) return;
  sample.gallery = std::max(1.0, sample.gallery);
  model.calibration = fit_calibration(sample, prior);
  validation = {};
  rows.resize(0, 0);
  next(Stage::kRemainingTemplates);
}

// Templates of the faces that are not training faces; afterwards all templates are in the order of
// the faces.
void Training::Impl::make_remaining_templates() {
  if (training_faces.size() == faces.size()) return finish();  // also with coordinates
  if (at == 0) {
    Rows all(static_cast<Eigen::Index>(faces.size()), model.template_length());
    for (std::size_t i = 0; i < training_faces.size(); ++i)
      all.row(static_cast<Eigen::Index>(training_faces[i])) =
          model.templates.row(static_cast<Eigen::Index>(i));
    model.templates = std::move(all);
  }
  constexpr std::size_t kChunk = 64;
  const std::size_t last = std::min(faces.size(), at + kChunk);
  cv::parallel_for_({static_cast<int>(at), static_cast<int>(last)}, [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) {
      const auto face = static_cast<std::size_t>(i);
      if (std::binary_search(training_faces.begin(), training_faces.end(), face)) continue;
      const std::vector<float> values = template_of(model, faces[face]);
      model.templates.row(i) = Eigen::Map<const Eigen::RowVectorXf>(
          values.data(), static_cast<Eigen::Index>(values.size()));
    }
  });
  work = static_cast<double>(last - at);
  at = last;
  if (at == faces.size()) finish();
}

void Training::Impl::finish() {
  model.people = people;
  model.labels = labels;
  model.refresh();
  next(Stage::kDone);
}

Training::Training(std::vector<cv::Mat> faces, const std::vector<std::string>& labels,
                   const RecognizerOptions& options, const Background* background,
                   int max_training_faces)
    : impl_(std::make_unique<Impl>()) {
  options.check();
  if (faces.empty()) throw std::invalid_argument("there are no faces to train on");
  TARSIER_REQUIRE(faces.size() == labels.size(), "{} faces, {} labels", faces.size(),
                  labels.size());
  Recognizer& model = impl_->model;
  model.options = options;
  for (const auto& face : faces) require_gray(face);
  if (options.algorithm == Algorithm::kDefault)
    model.options.size = options.descriptor.size;
  else if (options.algorithm == Algorithm::kDeep)
    model.options.size = {kChipSize, kChipSize};
  else if (options.size.area() == 0)
    model.options.size = faces.front().size();
  model.options.check();
  impl_->number_people(labels);
  impl_->training_faces = training_subset(impl_->people, max_training_faces);
  // The people of the training faces, numbered in order of appearance.
  std::map<int, int> renamed;
  for (const std::size_t i : impl_->training_faces) {
    const auto [entry, inserted] =
        renamed.try_emplace(impl_->people[i], static_cast<int>(renamed.size()));
    if (inserted) model.labels.push_back(impl_->labels[static_cast<std::size_t>(impl_->people[i])]);
    model.people.push_back(entry->second);
  }
  impl_->faces = std::move(faces);
  impl_->background = is_whitened(options.algorithm) ? background : nullptr;
  if (options.algorithm == Algorithm::kDeep) {
    require_network(background);
    model.network = background->network;
    impl_->has_background_basis = true;
  }
  impl_->copies =
      options.algorithm == Algorithm::kDefault && options.variants > 0 ? kPerturbations.size() : 1;
}

Training::Training(const Rows& coordinates, const std::vector<std::string>& labels,
                   const RecognizerOptions& options, const Background& background)
    : impl_(std::make_unique<Impl>()) {
  options.check();
  TARSIER_REQUIRE(is_whitened(options.algorithm),
                  "coordinates are for 'default' and 'deep', not {}", name_of(options.algorithm));
  if (options.algorithm == Algorithm::kDeep) {
    require_network(&background);
  } else {
    check_background(background, descriptor_length(options.descriptor));
  }
  const Eigen::Index m = background.basis.rows();
  TARSIER_REQUIRE(m > 0, "a background of a mean alone");
  TARSIER_REQUIRE(coordinates.rows() > 0 && coordinates.cols() == m + 1,
                  "{} rows of {} coordinates, the background has {} directions", coordinates.rows(),
                  coordinates.cols(), m);
  TARSIER_REQUIRE(static_cast<std::size_t>(coordinates.rows()) == labels.size(),
                  "{} faces, {} labels", coordinates.rows(), labels.size());
  impl_->number_people(labels);
  impl_->model.options = options;
  impl_->model.options.size = options.algorithm == Algorithm::kDeep ? cv::Size(kChipSize, kChipSize)
                                                                    : options.descriptor.size;
  impl_->model.network = background.network;
  impl_->model.labels = impl_->labels;
  impl_->model.people = impl_->people;
  impl_->coordinates = coordinates;
  impl_->background = &background;
  impl_->has_background_basis = true;
  impl_->stage = Impl::Stage::kLearn;
}

Training::~Training() = default;
Training::Training(Training&&) noexcept = default;
Training& Training::operator=(Training&&) noexcept = default;

double Training::work() const { return impl_->work; }

bool Training::step(Progress& progress, const std::stop_token& stop) {
  throw_if_stopped(stop);
  Impl& impl = *impl_;
  impl.work = 1;
  switch (impl.stage) {
    case Impl::Stage::kDescribe:
      impl.describe(progress, stop);
      break;
    case Impl::Stage::kLearn:
      if (impl.classical()) {
        impl.learn_classical(stop);
      } else if (impl.coordinates.size() > 0) {
        impl.learn_coordinates(progress);
      } else {
        impl.learn();
      }
      break;
    case Impl::Stage::kProject:
      impl.project();
      break;
    case Impl::Stage::kWhiten:
      impl.whiten_all();
      break;
    case Impl::Stage::kPrior:
      impl.compute_prior();
      break;
    case Impl::Stage::kFolds:
      impl.fold();
      break;
    case Impl::Stage::kRemainingTemplates:
      impl.make_remaining_templates();
      break;
    case Impl::Stage::kDone:
      return false;
  }
  if (impl.stage == Impl::Stage::kDone) progress.end();
  return impl.stage != Impl::Stage::kDone;
}

Recognizer Training::take() {
  TARSIER_REQUIRE(impl_->stage == Impl::Stage::kDone, "the training is not at its end");
  return std::move(impl_->model);
}

Recognizer train(std::span<const cv::Mat> faces, std::span<const std::string> labels,
                 const RecognizerOptions& options, Progress& progress, const std::stop_token& stop,
                 const Background* background) {
  Training training({faces.begin(), faces.end()}, {labels.begin(), labels.end()}, options,
                    background);
  while (training.step(progress, stop)) {
  }
  throw_if_stopped(stop);
  return training.take();
}

Recognizer train_coordinates(const Rows& coordinates, std::span<const std::string> labels,
                             const RecognizerOptions& options, Progress& progress,
                             const std::stop_token& stop, const Background& background) {
  Training training(coordinates, {labels.begin(), labels.end()}, options, background);
  while (training.step(progress, stop)) {
  }
  throw_if_stopped(stop);
  return training.take();
}

}  // namespace tarsier::face::recognition
