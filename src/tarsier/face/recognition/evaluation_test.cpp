// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>

namespace tarsier::face::recognition {
namespace {

using testing::HasSubstr;

std::vector<std::string> names(int people, int images) {
  std::vector<std::string> out;
  for (int p = 0; p < people; ++p)
    for (int i = 0; i < images; ++i) out.push_back("p" + std::to_string(p));
  return out;
}

TEST(Split, TakesTheSameNumberOfEachPerson) {
  const auto labels = names(6, 8);
  const auto split = split_of(labels, 3, 4);
  EXPECT_EQ(split.training.size(), 18U);
  EXPECT_EQ(split.probes.size(), 30U);
  std::set<int> all(split.training.begin(), split.training.end());
  all.insert(split.probes.begin(), split.probes.end());
  EXPECT_EQ(all.size(), 48U);
  for (int p = 0; p < 6; ++p)
    EXPECT_EQ(std::count_if(split.training.begin(), split.training.end(),
                            [&](int i) { return i / 8 == p; }),
              3);
  EXPECT_EQ(split_of(labels, 3, 4).training, split.training);
  EXPECT_NE(split_of(labels, 3, 5).training, split.training);
}

TEST(Split, AgreesWithNumpy) {
  // RandomState(0).permutation(10)[:5] is 2 8 4 9 1.
  EXPECT_THAT(split_of(names(1, 10), 5, 0).training, testing::ElementsAre(1, 2, 4, 8, 9));
}

TEST(Split, FacesThatMayNotTrainAreProbes) {
  // Two people with five faces each, and one more face each that may not train.
  std::vector<std::string> labels = names(2, 5);
  const Split without = split_of(labels, 3, 4);
  labels.insert(labels.end(), {labels.front(), labels.back()});
  std::vector<bool> may_train(10, true);
  may_train.resize(12, false);
  const Split with = split_of(labels, 3, 4, 0, may_train);
  EXPECT_EQ(with.training, without.training);
  std::vector<int> probes = without.probes;
  probes.insert(probes.end(), {10, 11});
  EXPECT_EQ(with.probes, probes);
}

TEST(Split, EnrolsTheGivenNumberOfPeople) {
  const auto split = split_of(names(7, 4), 2, 1, 3);
  EXPECT_EQ(split.training.size(), 6U);  // three people
  EXPECT_EQ(split.probes.size(), 22U);
  EXPECT_EQ(split_of(names(7, 4), 2, 1, 1).training.size(), 2U);
  // Limited to the number of people.
  EXPECT_EQ(split_of(names(7, 4), 2, 1, 9).training.size(), 14U);
  EXPECT_EQ(count_people(names(7, 4)), 7);
}

TEST(Split, GallerySplitEnrolsTheFirstFaces) {
  // Two images of each of four people are enrolled; three of each are probes.
  std::vector<std::string> labels = names(4, 2);
  const auto asked = names(4, 3);
  labels.insert(labels.end(), asked.begin(), asked.end());
  const auto all = split_of_gallery(labels, 8, 1);
  EXPECT_THAT(all.training, testing::ElementsAre(0, 1, 2, 3, 4, 5, 6, 7));
  EXPECT_EQ(all.probes.size(), 12U);
  EXPECT_EQ(all.probes.front(), 8);
  // With only some people enrolled, the gallery's images of the others are not probes either.
  const auto some = split_of_gallery(labels, 8, 1, 1);
  ASSERT_EQ(some.training.size(), 2U);
  EXPECT_EQ(labels[static_cast<std::size_t>(some.training[0])],
            labels[static_cast<std::size_t>(some.training[1])]);
  EXPECT_EQ(some.probes, all.probes);
  // The chosen person is the same as in split_of().
  const auto drawn = split_of(names(4, 5), 2, 1, 1);
  EXPECT_EQ(labels[static_cast<std::size_t>(some.training[0])],
            names(4, 5)[static_cast<std::size_t>(drawn.training[0])]);
  EXPECT_TRUE(split_of_gallery(labels, 20, 1).probes.empty());
}

TEST(AcceptRates, MatchHandCounts) {
  // Of ten strangers one may be accepted at 10 %: the lowest threshold is just above the second
  // best.
  const auto rates =
      accept_rates({0.5, 0.8, 0.95, 0.96}, {0.1, 0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.4, 0.6, 0.9}, 0.1);
  EXPECT_DOUBLE_EQ(rates.threshold, 0.8);
  EXPECT_DOUBLE_EQ(rates.true_accept_rate, 0.75);
  EXPECT_NEAR(rates.auc, (8 + 9 + 10 + 10) / 40.0, 1e-12);
  EXPECT_NEAR(rates.equal_error_rate, (0.25 + 0.2) / 2, 1e-12);
  // Equal scores of a known person and a stranger cannot be separated.
  EXPECT_DOUBLE_EQ(accept_rates({0.5}, {0.5}, 0.1).true_accept_rate, 0);
  EXPECT_DOUBLE_EQ(accept_rates({0.5}, {0.5}, 0.1).auc, 0.5);
}

TEST(Evaluate, ResultsCurvesAndTablesAgree) {
  const auto set = synthetic_faces(6, 5, 0.3, 1);
  EvaluationOptions options;
  options.training = 2;
  options.seeds = {3, 4};
  NoProgress quiet;
  std::vector<EvaluationResult> results;
  for (const auto algorithm : {Algorithm::kDefault, Algorithm::kEigen}) {
    RecognizerOptions recognizer;
    recognizer.algorithm = algorithm;
    results.push_back(evaluate(set.faces, set.labels, recognizer, options, quiet, {}));
  }
  const auto& first = results.front();
  ASSERT_EQ(first.seeds.size(), 2U);
  EXPECT_EQ(first.seeds[0].people, 6);
  EXPECT_EQ(first.seeds[0].probes, 18);
  EXPECT_EQ(first.seeds[0].unknown_probes, 15);
  EXPECT_EQ(first.seeds[0].known_probes, 9);
  EXPECT_GE(first.mean().accuracy, 0.95);
  EXPECT_NEAR(first.mean().accuracy, (first.seeds[0].accuracy + first.seeds[1].accuracy) / 2,
              1e-12);
  const auto match = cmc_curve(first);
  ASSERT_EQ(match.y.size(), 6U);
  EXPECT_NEAR(match.y.front(), first.mean().accuracy, 1e-12);
  EXPECT_DOUBLE_EQ(match.y.back(), 1);
  const auto accept = roc_curve(first);
  EXPECT_DOUBLE_EQ(accept.x.back(), 1);
  EXPECT_DOUBLE_EQ(accept.y.back(), 1);
  EXPECT_TRUE(std::is_sorted(accept.x.begin(), accept.x.end()));
  EXPECT_TRUE(std::is_sorted(accept.y.begin(), accept.y.end()));

  const auto csv = evaluation_csv(results);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 1 + 2 * 3);
  EXPECT_THAT(csv, HasSubstr("\neigen,2,all,6,36,"));
  EXPECT_EQ(cmc_plot(results, {640, 400}).size(), cv::Size(640, 400));
  EXPECT_THAT(roc_plot_svg(results, {640, 400}), HasSubstr("eigen"));

  options.training = 5;
  EXPECT_THROW((void)evaluate(set.faces, set.labels, {}, options, quiet, {}),
               std::invalid_argument);
}

TEST(Evaluate, CountsUncertainProbesSeparately) {
  const auto set = synthetic_faces(5, 4, 0.3, 1);
  EvaluationOptions options;
  options.training = 2;
  options.seeds = {0};
  NoProgress quiet;
  const SeedResult before = evaluate(set.faces, set.labels, {}, options, quiet, {}).seeds.front();
  // A face of the first person, and one with a wrong label.
  std::vector<cv::Mat> faces = set.faces;
  std::vector<std::string> labels = set.labels;
  faces.insert(faces.end(), {set.faces.front(), set.faces.front()});
  labels.insert(labels.end(), {set.labels.front(), set.labels.back()});
  options.may_train.assign(set.faces.size(), true);
  EXPECT_THROW((void)evaluate(faces, labels, {}, options, quiet, {}), std::invalid_argument);
  options.may_train.resize(faces.size(), false);
  const auto result = evaluate(faces, labels, {}, options, quiet, {});
  const SeedResult& after = result.seeds.front();
  EXPECT_EQ(after.training, before.training);
  EXPECT_EQ(after.probes, before.probes);
  EXPECT_EQ(after.accuracy, before.accuracy);
  EXPECT_EQ(after.unknown_probes, before.unknown_probes);
  EXPECT_EQ(after.uncertain_identified.hits, 1);
  EXPECT_EQ(after.uncertain_identified.trials, 2);
  EXPECT_EQ(before.uncertain_identified.trials, 0);
  EXPECT_NEAR(result.rate(&SeedResult::uncertain_identified).value, 0.5, 1e-12);
}

TEST(Evaluate, ProbesAreTheFacesOutsideTheGallery) {
  const auto set = synthetic_faces(5, 4, 0.3, 1);
  // The first image of each person is enrolled, in another order than the images of the probes.
  std::vector<cv::Mat> faces;
  std::vector<std::string> labels;
  for (const bool gallery : {true, false})
    for (std::size_t i = 0; i < set.faces.size(); ++i) {
      if ((i % 4 == 0) != gallery) continue;
      faces.push_back(set.faces[i]);
      labels.push_back(set.labels[i]);
    }
  EvaluationOptions options;
  options.gallery = 5;
  options.enrolled = 2;
  options.seeds = {0};
  NoProgress quiet;
  const auto result = evaluate(faces, labels, {}, options, quiet, {});
  const SeedResult& draw = result.seeds.front();
  EXPECT_EQ(draw.training, 5);
  EXPECT_EQ(draw.probes, 15);
  for (const ProbeResult& probe : draw.closed_set) EXPECT_GE(probe.face, 5);
  EXPECT_GE(draw.accuracy, 0.9);
  EXPECT_EQ(draw.known_probes, 6);
  EXPECT_EQ(draw.unknown_probes, 9);
  options.gallery = 20;
  EXPECT_THROW((void)evaluate(faces, labels, {}, options, quiet, {}), std::invalid_argument);
}

Background background_of_textures() {
  const auto many = synthetic_faces(60, 1, 0.3, 3, 500);
  BackgroundOptions options;
  options.components = 40;
  NoProgress quiet;
  return learn_background(many.faces, options, quiet, {});
}

TEST(Evaluate, TrainsWithTheBackground) {
  const auto set = synthetic_faces(6, 5, 0.3, 1);
  const Background general = background_of_textures();
  EvaluationOptions options;
  options.training = 2;
  options.seeds = {3};
  NoProgress quiet;
  const auto with = evaluate(set.faces, set.labels, {}, options, quiet, {}, &general);
  const auto without = evaluate(set.faces, set.labels, {}, options, quiet, {});
  EXPECT_TRUE(with.with_background);
  EXPECT_FALSE(without.with_background);
  // The scores are those of a recogniser that was trained with the background.
  const Split split = split_of(set.labels, 2, 3);
  std::vector<cv::Mat> faces;
  std::vector<std::string> labels;
  for (const int i : split.training) {
    faces.push_back(set.faces[static_cast<std::size_t>(i)]);
    labels.push_back(set.labels[static_cast<std::size_t>(i)]);
  }
  const Recognizer model = train(faces, labels, {}, quiet, {}, &general);
  const ProbeResult& probe = with.seeds[0].closed_set.front();
  const double score =
      identify(model, set.faces[static_cast<std::size_t>(probe.face)]).front().score;
  EXPECT_DOUBLE_EQ(probe.score, score);
  EXPECT_NE(probe.score, without.seeds[0].closed_set.front().score);

  // A single enrolled person has a threshold only with a background.
  options.enrolled = 1;
  const auto alone = evaluate(set.faces, set.labels, {}, options, quiet, {}, &general);
  EXPECT_TRUE(alone.seeds[0].calibrated);
  EXPECT_EQ(alone.seeds[0].known_probes, 3);
  EXPECT_EQ(alone.seeds[0].unknown_probes, 25);
  const auto guessing = evaluate(set.faces, set.labels, {}, options, quiet, {});
  EXPECT_FALSE(guessing.seeds[0].calibrated);
  EXPECT_EQ(guessing.rate(&SeedResult::calibrated_false_accept_count).value, -1);
}

TEST(Evaluate, CountsAcceptsAtTheCalibratedThreshold) {
  const auto set = synthetic_faces(6, 6, 0.3, 1);
  const Background general = background_of_textures();
  EvaluationOptions options;
  options.training = 2;
  options.seeds = {0, 1, 2};
  options.stated_rate = 0.05;
  NoProgress quiet;
  const auto result = evaluate(set.faces, set.labels, {}, options, quiet, {}, &general);
  // Counts again from the probes, with the threshold of a newly trained model.
  Count known;
  Count correct;
  Count unknown;
  for (const SeedResult& seed : result.seeds) {
    const Split split = split_of(set.labels, 2, seed.seed, 3);
    std::vector<cv::Mat> faces;
    std::vector<std::string> labels;
    for (const int i : split.training) {
      faces.push_back(set.faces[static_cast<std::size_t>(i)]);
      labels.push_back(set.labels[static_cast<std::size_t>(i)]);
    }
    const Recognizer model = train(faces, labels, {}, quiet, {}, &general);
    const double threshold = model.calibration->threshold(0.05, 3);
    for (const ProbeResult& probe : seed.open_set) {
      Count& count = probe.known ? known : unknown;
      ++count.trials;
      if (probe.score >= threshold) ++count.hits;
      if (probe.known && probe.correct && probe.score >= threshold) ++correct.hits;
    }
  }
  const Rate tar = result.rate(&SeedResult::calibrated_true_accept_count);
  const Rate far = result.rate(&SeedResult::calibrated_false_accept_count);
  EXPECT_EQ(tar.count.hits, known.hits);
  EXPECT_EQ(tar.count.trials, 3 * 3 * 4);
  EXPECT_EQ(result.rate(&SeedResult::calibrated_correct_accept_count).count.hits, correct.hits);
  EXPECT_EQ(far.count.hits, unknown.hits);
  EXPECT_EQ(far.count.trials, 3 * 3 * 6);
  EXPECT_EQ(far.draws, 3);
  // The interval is that of the 12 probes of one split, since further splits add no new images.
  const Interval expected = wilson_interval_of_rate(tar.value, 12);
  EXPECT_DOUBLE_EQ(tar.interval.low, expected.low);
  EXPECT_DOUBLE_EQ(tar.interval.high, expected.high);
  EXPECT_LE(tar.interval.low, tar.value);
  EXPECT_GE(tar.interval.high, tar.value);
  const Rate identified = result.rate(&SeedResult::identified);
  EXPECT_EQ(identified.count.trials, 3 * 24);
  EXPECT_NEAR(identified.value, result.mean().accuracy, 1e-12);
}

TEST(Evaluate, OpenSetNeedsUnknownPeople) {
  const auto set = synthetic_faces(3, 3, 0.3, 1);
  EvaluationOptions options;
  options.training = 1;
  options.enrolled = 3;
  NoProgress quiet;
  EXPECT_THROW((void)evaluate(set.faces, set.labels, {}, options, quiet, {}),
               std::invalid_argument);
}

class FaceList : public FolderTest {
 protected:
  std::vector<LabelledFace> read(const std::string& text) {
    std::ofstream(path("list")) << text;
    return read_face_list(path("list"));
  }
  std::string refusal(const std::string& text) {
    try {
      (void)read(text);
    } catch (const InputError& error) {
      return error.what();
    }
    return "it was read";
  }
};

TEST_F(FaceList, ReadsLabelsAndEyes) {
  std::ofstream(path("near.png")) << "x";
  const auto faces = read("# comment\n/a b/c.pgm\tAnn O'Neil\r\n\nnear.png\tb\t1\t2.5\t3\t4\n");
  ASSERT_EQ(faces.size(), 2U);
  EXPECT_EQ(faces[0].path, "/a b/c.pgm");
  EXPECT_EQ(faces[0].label, "Ann O'Neil");
  EXPECT_FALSE(faces[0].left_eye);
  EXPECT_EQ(faces[1].path, path("near.png"));  // beside the list
  EXPECT_EQ(*faces[1].left_eye, cv::Point2d(1, 2.5));
  EXPECT_EQ(*faces[1].right_eye, cv::Point2d(3, 4));
}

TEST_F(FaceList, ErrorNamesTheLine) {
  EXPECT_THAT(refusal("a\tb\nc\n"), HasSubstr("line 2"));
  EXPECT_THAT(refusal("a\t\n"), HasSubstr("line 1"));
  EXPECT_THAT(refusal("a\tb\t1\t2\t3\n"), HasSubstr("line 1"));
  EXPECT_THAT(refusal("a\tb\t1\t2\t3\tx\n"), HasSubstr("'x' is not a number"));
  EXPECT_THAT(refusal("a\tb\t1\t2\t3\tnan\n"), HasSubstr("'nan'"));
  EXPECT_THAT(refusal("a\tb\t1\t2\t1e9\t2\n"), HasSubstr("an eye at 1e9 px"));
  EXPECT_THAT(refusal("a\tb\t1\t2\t1.2\t2\n"), HasSubstr("line 1: eyes less than 1 px apart"));
  EXPECT_THAT(refusal(""), HasSubstr("no faces"));
  EXPECT_THROW((void)read_face_list(path("absent")), InputError);
  EXPECT_THROW((void)read_face_list(folder_), InputError);
}

TEST(EvaluateOrl, AccuraciesMatchThePublishedOnes) {
  TARSIER_LONG_TEST();
  const char* data = std::getenv("TARSIER_DATA");
  const auto folder = std::filesystem::path(data == nullptr ? "" : data) / "orl";
  if (!std::filesystem::is_directory(folder)) GTEST_SKIP() << "no ORL faces in TARSIER_DATA";
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    if (entry.path().extension() == ".pgm") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<cv::Mat> faces;
  std::vector<std::string> labels;
  for (const auto& file : files) {
    faces.push_back(read_gray_image(file.string()));
    labels.push_back(file.parent_path().filename().string());
  }
  ASSERT_EQ(faces.size(), 200U);
  EvaluationOptions options;
  NoProgress quiet;
  const auto accuracy = [&](Algorithm algorithm) {
    RecognizerOptions recognizer;
    recognizer.algorithm = algorithm;
    options.open_set = algorithm == Algorithm::kDefault;
    if (algorithm == Algorithm::kDefault) options.seeds = {0, 1};  // it is slow
    const auto result = evaluate(faces, labels, recognizer, options, quiet, {}).mean();
    if (options.open_set) {
      EXPECT_GE(result.true_accept_rate, 0.93);
    }
    return result.accuracy;
  };
  EXPECT_NEAR(accuracy(Algorithm::kEigen), 0.960, 0.02);
  EXPECT_NEAR(accuracy(Algorithm::kFisher), 0.974, 0.02);
  EXPECT_NEAR(accuracy(Algorithm::kLbph), 0.948, 0.02);
  EXPECT_GE(accuracy(Algorithm::kDefault), 0.985);
}

}  // namespace
}  // namespace tarsier::face::recognition
