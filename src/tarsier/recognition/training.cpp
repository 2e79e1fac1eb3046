// SPDX-License-Identifier: MIT
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/recognition/features.h"
#include "tarsier/recognition/folds.h"
#include "tarsier/recognition/recognizer.h"

#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

namespace tarsier::recognition {
namespace {

constexpr int kMostComponents = 256;  // of the default recogniser, unless asked otherwise
// Rows of the largest matrix whose eigenvectors training computes.
constexpr std::size_t kBasisRows = 480;
// Where nothing else is known of the scores of the default recogniser.
constexpr CalibrationPrior kPrior{0, 0.15, 0.5, 2};
// Of what a gallery adds to a background's components.
constexpr int kMostOwnComponents = 200;
// Strangers before one camera are more alike than the people of a background, whom many cameras
// took: by so much is their mean score higher, and it spreads so many times as far (measured on
// Yale and ORL, in front of one camera each).
constexpr double kSameCamera = 0.09;
constexpr double kSpread = 1.3;
// What this counts for beside strangers' scores in the gallery itself.
constexpr double kPriorPeople = 6;

struct Move {
  double dx, dy;  // of a face 64 px wide, px
  double degrees, growth;
};
constexpr std::array<Move, 7> kMoves{{{0, 0, 0, 0},
                                      {1.5, 0, 0, 0},
                                      {-1.5, 0, 0, 0},
                                      {0, 1.5, 0, 0},
                                      {0, -1.5, 0, 0},
                                      {0, 0, 3, 0.03},
                                      {0, 0, -3, -0.03}}};

// One row per face and move, the moves of a face one after the other.
Rows describe_all(std::span<const cv::Mat> faces, const RecognizerOptions& options,
                  std::size_t moves, Progress& progress, const std::stop_token& stop) {
  progress.begin("describing", static_cast<std::int64_t>(faces.size()), "faces");
  std::vector<std::vector<float>> features(faces.size() * moves);
  constexpr std::size_t kChunk = 16;  // between looks at the stop token
  for (std::size_t first = 0; first < faces.size(); first += kChunk) {
    throw_if_stopped(stop);
    const std::size_t last = std::min(faces.size(), first + kChunk);
    cv::parallel_for_(
        {static_cast<int>(first), static_cast<int>(last)}, [&](const cv::Range& range) {
          for (int i = range.start; i < range.end; ++i) {
            const auto face = static_cast<std::size_t>(i);
            if (moves == 1) {
              features[face] = features_of(faces[face], options);
              continue;
            }
            cv::Mat sized;
            cv::resize(faces[face], sized, options.descriptor.size, 0, 0,
                       faces[face].cols > options.descriptor.size.width ? cv::INTER_AREA
                                                                        : cv::INTER_LINEAR);
            const double px = options.variants * options.descriptor.size.width / 64;
            for (std::size_t m = 0; m < moves; ++m) {
              const Move& move = kMoves[m];
              features[face * moves + m] =
                  features_of(m == 0 ? sized
                                     : moved_face(sized, move.dx * px, move.dy * px,
                                                  move.degrees * options.variants,
                                                  1 + move.growth * options.variants),
                              options);
            }
          }
        });
    progress.advance(static_cast<std::int64_t>(last - first));
  }
  progress.end();
  Rows rows(static_cast<Eigen::Index>(features.size()),
            static_cast<Eigen::Index>(features.front().size()));
  for (std::size_t i = 0; i < features.size(); ++i)
    rows.row(static_cast<Eigen::Index>(i)) = Eigen::Map<const Eigen::RowVectorXf>(
        features[i].data(), static_cast<Eigen::Index>(features[i].size()));
  return rows;
}

Rows rows_at(const Rows& rows, const std::vector<std::size_t>& indices) {
  Rows out(static_cast<Eigen::Index>(indices.size()), rows.cols());
  for (std::size_t i = 0; i < indices.size(); ++i)
    out.row(static_cast<Eigen::Index>(i)) = rows.row(static_cast<Eigen::Index>(indices[i]));
  return out;
}

// Which rows the principal components are made of: every face as it is, then moved ones as far as
// they fit; of very many faces an even choice.
std::vector<std::size_t> basis_rows(std::size_t faces, std::size_t moves) {
  std::vector<std::size_t> rows;
  if (faces > kBasisRows) {
    for (std::size_t i = 0; i < kBasisRows; ++i) rows.push_back(i * faces / kBasisRows * moves);
    return rows;
  }
  for (std::size_t m = 0; m < moves && (m + 1) * faces <= std::max(kBasisRows, faces); ++m)
    for (std::size_t i = 0; i < faces; ++i) rows.push_back(i * moves + m);
  return rows;
}

// Directions in which the gallery differs from the mean beyond those of the background, after them.
Rows with_basis(const Rows& basis, const Rows& centred) {
  const Rows outside = centred - products(products(centred, basis), Rows(basis.transpose()));
  const Eigen::RowVectorXf zero = Eigen::RowVectorXf::Zero(centred.cols());
  const Pca more = principal_components(outside, kMostOwnComponents, &zero);
  Rows out(basis.rows() + more.components.rows(), basis.cols());
  out << basis, more.components;
  return out;
}

// What is known of the scatter within people, in the background's directions and `more` others.
Eigen::MatrixXd known_within(const Background& background, Eigen::Index more) {
  const Eigen::Index known = background.within.rows();
  const auto left = static_cast<double>(std::max<Eigen::Index>(1, background.mean.size() - known));
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(known + more, known + more);
  out.topLeftCorner(known, known) = background.within;
  out.diagonal().tail(more).setConstant(background.within_rest / left);
  return out;
}

// Off the mean face by chance, as the background's people are: their scores against the people of
// the gallery, each one by himself.
CalibrationPrior prior_of(const Recognizer& model, const Background& background) {
  constexpr int kStrangers = 400;
  CalibrationPrior prior = background.prior;
  double sum = 0;
  double square = 0;
  double count = 0;
  Rng rng(20);
  const Eigen::VectorXf deviation = background.variance.cwiseMax(0).cwiseSqrt().cast<float>();
  const Eigen::RowVectorXf shift = background.mean - model.mean;
  Rows in_template = products(background.basis, model.components);  // m x c
  const Rows shift_in_template = products(Rows(shift), model.components);
  const Rows shift_in_basis = products(Rows(shift), background.basis);
  for (int i = 0; i < kStrangers; ++i) {
    Rows x(1, deviation.size());
    for (Eigen::Index k = 0; k < deviation.size(); ++k)
      x(0, k) = deviation(k) * static_cast<float>(rng.normal());
    Rows probe = x * in_template + shift_in_template;
    Eigen::VectorXd length(1);
    length(0) = (x + shift_in_basis).cast<double>().squaredNorm() +
                std::max(0.0, shift.cast<double>().squaredNorm() -
                                  shift_in_basis.cast<double>().squaredNorm()) +
                background.outside;
    scale_rows(probe, length, model.importance, model.rest);
    const std::vector<float> values(probe.data(), probe.data() + probe.size());
    for (const PersonScore& person : identify_template(model, values)) {
      sum += person.score;
      square += person.score * person.score;
      count += 1;
    }
  }
  const double mean = sum / count;
  prior.location = mean + kSameCamera;
  prior.scale = std::max(0.02, kSpread * std::sqrt(std::max(0.0, square / count - mean * mean)));
  prior.weight = kPriorPeople;
  return prior;
}

void train_default(Recognizer& model, const Rows& rows, std::size_t moves,
                   const Background* background) {
  const std::size_t faces = model.people.size();
  const int people = static_cast<int>(model.labels.size());
  std::vector<std::size_t> upright(faces);
  for (std::size_t i = 0; i < faces; ++i) upright[i] = i * moves;
  // With one person alone the mean would be the person: none is taken off then.
  Eigen::RowVectorXf mean =
      people > 1 || background != nullptr
          ? Eigen::RowVectorXf(rows_at(rows, upright).cast<double>().colwise().mean().cast<float>())
          : Eigen::RowVectorXf::Zero(rows.cols());
  if (background != nullptr) {
    background->check();
    TARSIER_REQUIRE(background->mean.size() == rows.cols(),
                    "a background of {} numbers for descriptors of {}", background->mean.size(),
                    rows.cols());
    // One person says nothing of the mean of people.
    const double own = people > 1 ? people : 0;
    const double share = own / (own + background->weight);
    mean = static_cast<float>(share) * mean + static_cast<float>(1 - share) * background->mean;
  }
  const bool informed = background != nullptr && background->basis.rows() > 0;
  const int most = model.options.components > 0 ? model.options.components : kMostComponents;
  const auto basis = basis_rows(faces, moves);
  Rows components;  // principal, orthonormal
  if (informed) {
    components = with_basis(background->basis, rows_at(rows, basis).rowwise() - mean);
  } else {
    components = principal_components(rows_at(rows, basis), 0, &mean).components;
  }
  TARSIER_REQUIRE(components.rows() > 0, "the faces are flat or all the same");

  const Rows centred = rows.rowwise() - mean;
  Folds folds;
  folds.coefficients = products(centred, components).cast<double>();
  folds.people = model.people;
  folds.person_count = people;
  folds.moves = static_cast<int>(moves);
  folds.basis = basis;
  folds.most = most;
  folds.ridge = model.options.ridge;
  folds.mean_weight = model.options.mean_weight;
  if (informed) {
    folds.known_within = known_within(*background, components.rows() - background->basis.rows());
    folds.known_weight = background->within_weight;
  }
  const Eigen::Index kept =
      informed ? components.rows() : std::min<Eigen::Index>(most, components.rows());
  const Whitening white = folds.whitener(folds.coefficients.leftCols(kept), {});
  model.mean = mean;
  model.components =
      (white.directions.transpose() * components.topRows(kept).cast<double>()).cast<float>();
  model.importance = white.scatter;
  model.rest = white.rest;
  const Rows own = rows_at(centred, upright);
  model.templates = products(own, model.components);
  scale_rows(model.templates, own.cast<double>().rowwise().squaredNorm(), model.importance,
             model.rest);
  if (background != nullptr) {
    folds.background =
        (components * (background->mean - mean).transpose()).transpose().cast<double>();
    folds.background_weight = background->weight;
  }
  // One person without a background: no stranger's score is known, nor what it would be.
  if (people < 2 && background == nullptr) return;
  CalibrationPrior prior = background != nullptr ? background->prior : kPrior;
  if (informed) {
    model.refresh();
    prior = prior_of(model, *background);
  }
  model.calibration = fit_calibration(folds.scores(), prior);
}

// Eigenfaces and Fisherfaces: distances have no scale of their own, so no prior.
void calibrate_pixels(Recognizer& model, const Rows& rows) {
  if (model.labels.size() < 2) return;
  ScoreSample sample;
  if (model.people.size() <= kBasisRows) {
    const Pca pca = principal_components(rows);
    Folds folds;
    folds.algorithm = model.options.algorithm;
    folds.coefficients = products(rows.rowwise() - pca.mean, pca.components).cast<double>();
    folds.people = model.people;
    folds.person_count = static_cast<int>(model.labels.size());
    for (std::size_t i = 0; i < model.people.size(); ++i) folds.basis.push_back(i);
    folds.most = model.options.components;
    sample = folds.scores();
  } else {
    sample = left_out_scores(model);
  }
  if (!sample.stranger.empty()) model.calibration = fit_calibration(sample, {0, 1, 0, 0});
}

void train_fisher(Recognizer& model, const Rows& rows) {
  const int people = static_cast<int>(model.labels.size());
  const auto faces = static_cast<int>(rows.rows());
  if (people < 2) {
    throw std::invalid_argument("Fisherfaces needs faces of at least two people, there is one");
  }
  if (faces <= people)
    throw std::invalid_argument("Fisherfaces needs more than one picture of somebody");
  const Pca pca = principal_components(rows, faces - people);
  TARSIER_REQUIRE(pca.components.rows() > 0, "the faces are flat or all the same");
  const Eigen::MatrixXd coefficients =
      products(rows.rowwise() - pca.mean, pca.components).cast<double>();
  Eigen::MatrixXd directions =
      linear_discriminants(coefficients, model.people, people, &model.importance);
  if (model.options.components > 0 && directions.cols() > model.options.components) {
    directions = directions.leftCols(model.options.components).eval();
    model.importance = model.importance.head(model.options.components).eval();
  }
  model.mean = pca.mean;
  model.components = (directions.transpose() * pca.components.cast<double>()).cast<float>();
}

}  // namespace

void Background::check() const {
  TARSIER_REQUIRE(mean.size() > 0 && mean.allFinite() && weight > 0 && weight <= 1000,
                  "a background of {} numbers, weight {}", mean.size(), weight);
  const Eigen::Index m = basis.rows();
  if (m == 0) return;
  TARSIER_REQUIRE(basis.cols() == mean.size() && basis.allFinite() && variance.size() == m &&
                      variance.allFinite() && variance.minCoeff() >= 0 && within.rows() == m &&
                      within.cols() == m && within.allFinite(),
                  "a background's parts do not fit together");
  TARSIER_REQUIRE(std::isfinite(outside) && outside >= 0 && std::isfinite(within_rest) &&
                      within_rest >= 0 && within_weight > 0 && within_weight <= 1e6,
                  "outside {}, within {}, weight {}", outside, within_rest, within_weight);
}

Background background_of(std::span<const cv::Mat> faces, const DescriptorOptions& options) {
  TARSIER_REQUIRE(!faces.empty(), "no faces");
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(descriptor_length(options));
  for (const auto& face : faces) {
    const auto values = describe(face, options);
    sum += Eigen::Map<const Eigen::RowVectorXf>(values.data(),
                                                static_cast<Eigen::Index>(values.size()))
               .cast<double>();
  }
  Background out;
  out.mean = (sum / static_cast<double>(faces.size())).cast<float>();
  return out;
}

Recognizer train(std::span<const cv::Mat> faces, std::span<const std::string> labels,
                 const RecognizerOptions& options, Progress& progress, const std::stop_token& stop,
                 const Background* background) {
  options.check();
  if (faces.empty()) throw std::invalid_argument("there are no faces to train on");
  TARSIER_REQUIRE(faces.size() == labels.size(), "{} faces, {} labels", faces.size(),
                  labels.size());
  Recognizer model;
  model.options = options;
  for (const auto& face : faces) require_gray(face);
  if (options.algorithm == Algorithm::kDefault)
    model.options.size = options.descriptor.size;
  else if (options.size.area() == 0)
    model.options.size = faces.front().size();
  model.options.check();
  std::map<std::string, int> index;
  for (const auto& label : labels) {
    const auto [entry, fresh] = index.try_emplace(label, static_cast<int>(index.size()));
    if (fresh) model.labels.push_back(label);
    model.people.push_back(entry->second);
  }

  const std::size_t moves =
      options.algorithm == Algorithm::kDefault && options.variants > 0 ? kMoves.size() : 1;
  const Rows rows = describe_all(faces, model.options, moves, progress, stop);
  throw_if_stopped(stop);
  progress.begin("training", 0, "steps");
  const int people = static_cast<int>(model.labels.size());
  switch (options.algorithm) {
    case Algorithm::kDefault:
      train_default(model, rows, moves, background);
      break;
    case Algorithm::kEigen: {
      Pca pca = principal_components(rows, options.components);
      if (pca.components.rows() == 0) {  // one picture: the distance to the mean along nothing
        throw std::invalid_argument("Eigenfaces needs two different pictures");
      }
      model.mean = pca.mean;
      model.components = std::move(pca.components);
      model.importance = std::move(pca.variance);
      break;
    }
    case Algorithm::kFisher:
      train_fisher(model, rows);
      break;
    case Algorithm::kLbph:
      model.templates = rows;
      break;
  }
  if (options.algorithm == Algorithm::kEigen || options.algorithm == Algorithm::kFisher) {
    model.templates = products(rows.rowwise() - model.mean, model.components);
    calibrate_pixels(model, rows);
  } else if (options.algorithm == Algorithm::kLbph && people > 1) {
    model.calibration = fit_calibration(left_out_scores(model), {0, 1, 0, 0});
  }
  model.refresh();
  progress.end();
  throw_if_stopped(stop);
  return model;
}

}  // namespace tarsier::recognition
