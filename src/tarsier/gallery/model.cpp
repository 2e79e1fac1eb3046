// SPDX-License-Identifier: MIT
#include "tarsier/gallery/model.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/people_face/classical.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <span>
#include <utility>

namespace tarsier::people {
namespace {

using recognition::Algorithm;
using recognition::Recognizer;

// The stored subspace with the templates of the faces. Nothing where they do not fit together: it
// is learned anew then.
std::optional<Recognizer> stored_model(Gallery& gallery, const std::vector<Person>& people) {
  const std::optional<std::string> body = gallery.model();
  if (!body) return std::nullopt;
  Recognizer model;
  try {
    model = recognition::recognizer_from_text(*body, gallery.path());
  } catch (const Error&) {
    return std::nullopt;
  }
  const std::vector<StoredFace> faces = gallery.faces(std::nullopt, false);
  std::map<std::int64_t, int> index;
  const int length = model.template_length();
  model.labels.clear();
  model.people.clear();
  model.templates.resize(static_cast<Eigen::Index>(faces.size()), length);
  for (const StoredFace& face : faces) {
    const auto person = std::find_if(people.begin(), people.end(),
                                     [&](const Person& p) { return p.id == face.person; });
    if (person == people.end() || static_cast<int>(face.features.size()) != length)
      return std::nullopt;
    const auto [entry, fresh] = index.try_emplace(face.person, static_cast<int>(index.size()));
    if (fresh) model.labels.push_back(person->name);
    model.templates.row(static_cast<Eigen::Index>(model.people.size())) =
        Eigen::Map<const Eigen::RowVectorXf>(face.features.data(), length);
    model.people.push_back(entry->second);
  }
  try {
    model.check();
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
  model.refresh();
  return model;
}

void store(Gallery& gallery, const Recognizer& model, const std::vector<StoredFace>& faces,
           std::int64_t generation) {
  Recognizer subspace = model;
  subspace.labels.clear();
  subspace.people.clear();
  subspace.templates.resize(0, model.template_length());
  std::vector<std::pair<std::int64_t, std::vector<float>>> templates;
  for (std::size_t i = 0; i < faces.size(); ++i) {
    const auto row = model.templates.row(static_cast<Eigen::Index>(i));
    templates.emplace_back(faces[i].id, std::vector<float>(row.data(), row.data() + row.size()));
  }
  gallery.store_model(recognition::recognizer_text(subspace), generation, templates);
}

}  // namespace

cv::Mat recognizer_input(Algorithm algorithm, const cv::Mat& crop) {
  return algorithm == Algorithm::kDefault ? crop : classical_face(crop);
}

std::optional<Recognizer> gallery_model(Gallery& gallery, const recognition::Background* background,
                                        bool store_it, Progress& progress,
                                        const std::stop_token& stop) {
  const std::vector<Person> people = gallery.people();
  if (std::optional<Recognizer> stored = stored_model(gallery, people)) {
    if (stored->templates.rows() > 0) return stored;
  }
  const std::int64_t generation = gallery.generation();
  const std::vector<StoredFace> faces = gallery.faces();
  if (faces.empty()) return std::nullopt;
  recognition::RecognizerOptions options;
  try {
    options.algorithm = recognition::parse_algorithm(gallery.algorithm());
  } catch (const std::invalid_argument& error) {
    throw InputError(gallery.path(), error.what());
  }
  std::vector<cv::Mat> inputs;
  std::vector<std::string> labels;
  for (const StoredFace& face : faces) {
    const auto person = std::find_if(people.begin(), people.end(),
                                     [&](const Person& p) { return p.id == face.person; });
    if (person == people.end()) throw InputError(gallery.path(), "a face of nobody: is damaged");
    inputs.push_back(recognizer_input(options.algorithm, face.crop));
    labels.push_back(person->name);
  }
  const bool general = options.algorithm == Algorithm::kDefault;
  if (!general) {
    // A classical recogniser has no other defence against faces that look the other way.
    for (std::size_t i = 0, n = inputs.size(); i < n; ++i) {
      cv::Mat mirrored;
      cv::flip(inputs[i], mirrored, 1);
      inputs.push_back(mirrored);
      labels.push_back(labels[i]);
    }
  }
  Recognizer model =
      recognition::train(inputs, labels, options, progress, stop, general ? background : nullptr);
  if (!general) {  // templates of mirrored faces were for learning
    const auto own = static_cast<Eigen::Index>(faces.size());
    model.templates = model.templates.topRows(own).eval();
    model.people.resize(faces.size());
    model.refresh();
  }
  if (store_it) store(gallery, model, faces, generation);
  return model;
}

Recognition recognize(const Recognizer& model, const std::vector<float>& features,
                      double false_accepts) {
  TARSIER_REQUIRE(false_accepts > 0 && false_accepts < 1, "a rate of {}", false_accepts);
  Recognition out;
  const auto scores = recognition::identify_template(model, features);
  if (scores.empty()) return out;
  const recognition::PersonScore& best = scores.front();
  out.label = model.labels[static_cast<std::size_t>(best.person)];
  out.score = best.score;
  out.nearest = best.nearest;
  if (!model.calibration) return out;
  const recognition::Calibration& calibration = *model.calibration;
  out.threshold = calibration.threshold(false_accepts, static_cast<int>(model.labels.size()));
  out.known = out.score >= out.threshold;
  const double slope = calibration.slope > 0 ? calibration.slope : 1 / calibration.scale;
  out.confidence = 1 / (1 + std::exp(-slope * (out.score - out.threshold)));
  return out;
}

std::vector<std::string> other_names(const Recognizer& model, const std::vector<cv::Mat>& crops,
                                     const std::string& name) {
  constexpr double kRate = 0.001;
  std::map<std::string, std::size_t> taken_for;
  for (const cv::Mat& crop : crops) {
    const Recognition seen = recognize(
        model, recognition::template_of(model, recognizer_input(model.options.algorithm, crop)),
        kRate);
    if (seen.known && seen.label != name) ++taken_for[seen.label];
  }
  std::vector<std::string> out;
  for (const auto& [label, count] : taken_for)
    if (2 * count > crops.size()) out.push_back(label);
  return out;
}

}  // namespace tarsier::people
