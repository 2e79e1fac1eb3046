// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/person_study.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/landmarks/evaluation.h"
#include "tarsier/face/landmarks/train_model.h"

#include <map>

namespace tarsier::face::landmarks {

namespace {

constexpr std::size_t kMinImages = 4;
constexpr int kSpecificStarts = 40;
constexpr int kGenericStarts = 12;
constexpr int kTestStarts = 5;

double error_of(const Descent& model, const std::vector<TrainingFace>& faces,
                const std::array<int, 2>& eyes, std::uint64_t seed) {
  DescentWorkspace workspace;
  double sum = 0;
  const std::vector<Start> starts = scattered_starts(faces, model.mean, kTestStarts, seed + 1);
  for (const Start& start : starts) {
    const TrainingFace& face = faces[static_cast<std::size_t>(start.face)];
    const Eigen::Matrix2Xd points = fit_descent(model, face.gray, start.points, workspace);
    const double unit = (face.points.col(eyes[0]) - face.points.col(eyes[1])).norm();
    sum += (points - face.points).colwise().norm().mean() / unit * 100;
  }
  return sum / static_cast<double>(starts.size());
}

Descent descent_of(const std::vector<TrainingFace>& faces, int starts, std::uint64_t seed,
                   const std::stop_token& stop) {
  std::vector<Eigen::Matrix2Xd> shapes;
  for (const TrainingFace& face : faces) shapes.push_back(face.points);
  const Eigen::Matrix2Xd mean = shape::train_shape_model(shapes).mean;
  DescentOptions options;
  options.seed = seed;
  NoProgress silent;
  return train_descent(faces, scattered_starts(faces, mean, starts, seed), options, silent, stop);
}

}  // namespace

PersonStudy study_persons(const shape::LandmarkSet& set, const std::array<int, 2>& eyes,
                          std::uint64_t seed, Progress& progress, const std::stop_token& stop) {
  std::vector<std::string> skipped;
  const std::vector<TrainingFace> faces =
      load_training_faces(set, "", LoadOptions{}, progress, stop, skipped);
  std::map<std::string, std::vector<TrainingFace>> people;
  for (const TrainingFace& face : faces) {
    if (!face.person.empty()) people[face.person].push_back(face);
  }
  PersonStudy study;
  progress.begin("people", static_cast<std::int64_t>(people.size()), "people");
  for (const auto& [person, own] : people) {
    throw_if_stopped(stop);
    progress.advance();
    if (own.size() < kMinImages || people.size() < 2) continue;
    const auto half = own.begin() + static_cast<std::ptrdiff_t>(own.size() / 2);
    const std::vector<TrainingFace> train(own.begin(), half);
    const std::vector<TrainingFace> test(half, own.end());
    std::vector<TrainingFace> others;
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
