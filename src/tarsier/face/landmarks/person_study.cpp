// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/person_study.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/landmarks/evaluation.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/starts.h"

#include <map>

namespace tarsier::face::landmarks {

namespace {

constexpr std::size_t kMinImages = 4;
constexpr int kSpecificStarts = 40;
constexpr int kGenericStarts = 12;
constexpr int kTestStarts = 5;

double error_of(const regression::Descent& model,
                const std::vector<regression::TrainingFace>& faces, const std::array<int, 2>& eyes,
                std::uint64_t seed) {
  regression::DescentWorkspace workspace;
  double sum = 0;
  const std::vector<regression::Start> starts =
      regression::scattered_starts(faces, model.mean, kTestStarts, seed + 1);
  for (const regression::Start& start : starts) {
    const regression::TrainingFace& face = faces[static_cast<std::size_t>(start.face)];
    const Eigen::Matrix2Xd points =
        regression::fit_descent(model, face.gray, start.points, workspace);
    const double unit = (face.points.col(eyes[0]) - face.points.col(eyes[1])).norm();
    sum += (points - face.points).colwise().norm().mean() / unit * 100;
  }
  return sum / static_cast<double>(starts.size());
}

regression::Descent descent_of(const std::vector<regression::TrainingFace>& faces, int starts,
                               std::uint64_t seed, const std::stop_token& stop) {
  std::vector<Eigen::Matrix2Xd> shapes;
  shapes.reserve(faces.size());
  for (const regression::TrainingFace& face : faces) shapes.push_back(face.points);
  const Eigen::Matrix2Xd mean = shape::train_shape_model(shapes).mean;
  regression::DescentOptions options;
  options.seed = seed;
  NoProgress silent;
  return regression::train_descent(faces, regression::scattered_starts(faces, mean, starts, seed),
                                   options, silent, stop);
}

}  // namespace

PersonStudy study_persons(const shape::LandmarkSet& set, const std::array<int, 2>& eyes,
                          std::uint64_t seed, Progress& progress, const std::stop_token& stop) {
  std::vector<std::string> skipped;
  const std::vector<regression::TrainingFace> faces =
      regression::load_training_faces(set, "", regression::LoadOptions{}, progress, stop, skipped);
  std::map<std::string, std::vector<regression::TrainingFace>> people;
  for (const regression::TrainingFace& face : faces) {
    if (!face.person.empty()) people[face.person].push_back(face);
  }
  PersonStudy study;
  progress.begin("people", static_cast<std::int64_t>(people.size()), "people");
  for (const auto& [person, own] : people) {
    throw_if_stopped(stop);
    progress.advance();
    if (own.size() < kMinImages || people.size() < 2) continue;
    const auto half = own.begin() + static_cast<std::ptrdiff_t>(own.size() / 2);
    const std::vector<regression::TrainingFace> train(own.begin(), half);
    const std::vector<regression::TrainingFace> test(half, own.end());
    std::vector<regression::TrainingFace> others;
    for (const auto& [name, theirs] : people) {
      if (name != person) others.insert(others.end(), theirs.begin(), theirs.end());
    }
    PersonStudy::Row row;
    row.person = person;
    row.trained = static_cast<int>(train.size());
    row.tested = static_cast<int>(test.size());
    row.generic = error_of(descent_of(others, kGenericStarts, seed, stop), test, eyes, seed);
    row.specific = error_of(descent_of(train, kSpecificStarts, seed, stop), test, eyes, seed);
    study.rows.push_back(row);
  }
  progress.end();
  if (study.rows.empty()) {
    throw InputError("by-person study",
                     "the set needs two people with at least 4 complete images each");
  }
  for (const PersonStudy::Row& row : study.rows) {
    study.generic += row.generic / static_cast<double>(study.rows.size());
    study.specific += row.specific / static_cast<double>(study.rows.size());
  }
  return study;
}

}  // namespace tarsier::face::landmarks
