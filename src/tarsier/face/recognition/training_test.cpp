// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/training.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/recognition/testing_faces.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

namespace tarsier::face::recognition {
namespace {

TEST(TrainingSubset, SamplesEvenlyAboveTheLimit) {
  EXPECT_THAT(training_subset({0, 1, 1, 2}, 4), testing::ElementsAre(0, 1, 2, 3));
  std::vector<int> people;
  for (int i = 0; i < 10'000; ++i) people.push_back(i % 1000);  // ten images of each
  const auto sample = training_subset(people, 200);
  EXPECT_LE(sample.size(), 200U);
  EXPECT_GE(sample.size(), 190U);
  EXPECT_TRUE(std::is_sorted(sample.begin(), sample.end()));
  EXPECT_EQ(std::set<std::size_t>(sample.begin(), sample.end()).size(), sample.size());
  std::map<int, int> of_person;
  for (const std::size_t i : sample) ++of_person[people[i]];
  EXPECT_GE(of_person.size(), 45U);
  for (const auto& [person, count] : of_person) EXPECT_EQ(count, 4) << person;
  EXPECT_GT(of_person.rbegin()->first, 900);
  // Few people with very many images: more images of each.
  std::fill(people.begin(), people.end(), 0);
  people[7] = 1;
  EXPECT_GE(training_subset(people, 200).size(), 100U);
}

// If there are more faces than learning uses, each face still has its template.
TEST(Training, FacesOutsideTheSubsetHaveTemplates) {
  const auto set = synthetic_faces(10, 4, 0.3, 1);
  NoProgress quiet;
  Training training(set.faces, set.labels, {}, nullptr, 20);
  while (training.step(quiet, {})) {
  }
  const Recognizer model = training.take();
  ASSERT_EQ(model.templates.rows(), 40);
  EXPECT_EQ(model.labels.size(), 10U);
  EXPECT_NO_THROW(model.check());
  EXPECT_LE(model.calibration->impostor_people, 5);
  const auto probes = synthetic_faces(10, 2, 0.3, 2);
  int right = 0;
  for (std::size_t i = 0; i < probes.faces.size(); ++i)
    if (model.labels[static_cast<std::size_t>(identify(model, probes.faces[i]).front().person)] ==
        probes.labels[i])
      ++right;
  EXPECT_GE(right, 18);  // of 20
}

TEST(Training, StepsGiveTheModelOfTrain) {
  const auto set = synthetic_faces(6, 4, 0.3, 1);
  NoProgress quiet;
  const Recognizer at_once = train(set.faces, set.labels, {}, quiet, {});
  Training training(set.faces, set.labels, {}, nullptr);
  int steps = 1;
  double total = 0;
  double largest = 0;
  while (training.step(quiet, {})) {
    ++steps;
    total += training.work();
    largest = std::max(largest, training.work());
  }
  const Recognizer stepwise = training.take();
  EXPECT_EQ(stepwise.templates, at_once.templates);
  EXPECT_DOUBLE_EQ(stepwise.calibration->location, at_once.calibration->location);
  EXPECT_GE(steps, 10);
  EXPECT_LT(largest, 0.7 * total);
}

// It can be stopped between any two steps, not only while faces are described.
TEST(Training, CanBeInterruptedBeforeEachStep) {
  const auto set = synthetic_faces(6, 4, 0.3, 1);
  NoProgress quiet;
  for (int after = 0;; ++after) {
    Training training(set.faces, set.labels, {}, nullptr);
    bool more = true;
    for (int i = 0; i < after && more; ++i) more = training.step(quiet, {});
    if (!more) {
      EXPECT_GE(after, 10);
      break;
    }
    std::stop_source stop;
    stop.request_stop();
    EXPECT_THROW((void)training.step(quiet, stop.get_token()), Interrupted) << after;
  }
}

}  // namespace
}  // namespace tarsier::face::recognition
