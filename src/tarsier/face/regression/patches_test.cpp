// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/patches.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/face/regression/testing_distance.h"
#include "tarsier/media/archive.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <utility>
#include <vector>

namespace tarsier::face::regression {
namespace {

using shape::Similarity2d;
using test_support::mean_distance;

// A synthetic image whose value is known at every point: a sum of waves in the face's frame. Image
// and points are symmetric under a rotation by 180 degrees. So the error that the background causes
// at one point has the opposite sign at the opposite point. The mean then contains only errors of
// the code.
struct Texture {
  struct Wave {
    double x, y, height;
  };
  std::vector<Wave> waves;

  explicit Texture(Rng rng) {
    for (int k = 0; k < 16; ++k) {
      const double length = rng.uniform(9, 40);  // px in the face's frame
      const double angle = rng.uniform(0, std::numbers::pi);
      waves.push_back({2 * std::numbers::pi / length * std::cos(angle),
                       2 * std::numbers::pi / length * std::sin(angle),
                       (k % 2 == 0 ? 1 : -1) * rng.uniform(7, 14)});
    }
  }
  [[nodiscard]] double at(const Eigen::Vector2d& p) const {
    double value = 120;
    for (const Wave& wave : waves) value += wave.height * std::cos(wave.x * p.x() + wave.y * p.y());
    return value;
  }
};

Eigen::Matrix2Xd face_points() {
  Eigen::Matrix2Xd points(2, 8);
  points << -50, 50, -25, 25, 22, -22, 6, -6,  //
      -8, 8, -30, 30, -27, 27, 9, -9;
  return points;
}

cv::Mat paint(cv::Size size, const Similarity2d& image_from_face, const Texture& texture,
              double noise, Rng& rng) {
  const Similarity2d face_from_image = image_from_face.inverse();
  cv::Mat gray(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x)
      gray.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(
          texture.at(face_from_image(Eigen::Vector2d(x, y))) + noise * rng.normal());
  return gray;
}

Similarity2d random_similarity(Rng& rng, double scale) {
  const double s = scale * rng.uniform(0.9, 1.1);
  const double angle = rng.uniform(-0.15, 0.15);
  return {s * std::cos(angle), s * std::sin(angle), 110 * scale + rng.uniform(-3, 3),
          100 * scale + rng.uniform(-3, 3)};
}

TrainingFace textured_face(Rng& rng, const Texture& texture, double scale) {
  const Similarity2d similarity = random_similarity(rng, scale);
  const auto side = [&](double px) { return static_cast<int>(px * scale); };
  TrainingFace face;
  face.gray = paint({side(220), side(200)}, similarity, texture, 4, rng);
  face.points = similarity(face_points());
  return face;
}

// A blob at each point, each with its own direction and sign. `amount` opens the mouth.
Eigen::Matrix2Xd opened(double amount) {
  Eigen::Matrix2Xd points = face_points();
  points(1, 3) += amount;
  points(1, 5) += amount;
  points(1, 6) += 0.3 * amount;
  return points;
}

TrainingFace blob_face(Rng& rng, double opening) {
  const Similarity2d similarity = random_similarity(rng, 1);
  TrainingFace face;
  face.points = similarity(opened(opening));
  face.gray.create(200, 220, CV_8UC1);
  for (int y = 0; y < face.gray.rows; ++y) {
    for (int x = 0; x < face.gray.cols; ++x) {
      double value = 100 + 2 * rng.normal();
      for (int i = 0; i < 8; ++i) {
        const Eigen::Vector2d d = Eigen::Vector2d(x, y) - face.points.col(i);
        const double angle = i * std::numbers::pi / 4;
        const double along = (d.x() * std::cos(angle) + d.y() * std::sin(angle)) / 6;
        const double across = (d.y() * std::cos(angle) - d.x() * std::sin(angle)) / 2.5;
        value += (i % 8 < 4 ? 110 : -80) * std::exp(-(along * along + across * across) / 2);
      }
      face.gray.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(value);
    }
  }
  return face;
}

shape::ShapeModel shape_of_faces(const std::vector<TrainingFace>& faces) {
  std::vector<Eigen::Matrix2Xd> shapes;
  for (const TrainingFace& face : faces) shapes.push_back(face.points);
  shape::ShapeModelOptions options;
  options.max_modes = 1;
  return shape::train_shape_model(shapes, options);
}

struct Trained {
  std::vector<TrainingFace> faces;
  shape::ShapeModel shape;
  PatchModels patches;
};

PatchModels trained_patches(const std::vector<TrainingFace>& faces, const shape::ShapeModel& shape,
                            const PatchOptions& options) {
  NoProgress progress;
  return train_patches(faces, shape, options, progress, {});
}

PatchOptions small_options(PatchMethod method = PatchMethod::kRidge) {
  PatchOptions options;
  options.method = method;
  options.face_width = 100;
  options.search = 11;
  options.samples = 300;
  return options;
}

Trained train_textured(PatchMethod method, double scale) {
  Trained out;
  Rng rng(5);
  const Texture texture(rng.fork(1));
  for (int k = 0; k < 20; ++k) out.faces.push_back(textured_face(rng, texture, scale));
  out.shape = shape_of_faces(out.faces);
  out.patches = trained_patches(out.faces, out.shape, small_options(method));
  return out;
}

Trained train_blobs(PatchMethod method) {
  Trained out;
  Rng rng(9);
  for (int k = 0; k < 24; ++k) out.faces.push_back(blob_face(rng, rng.uniform(-6, 18)));
  out.shape = shape_of_faces(out.faces);
  PatchOptions options = small_options(method);
  options.search = 21;
  out.patches = trained_patches(out.faces, out.shape, options);
  return out;
}

// Each model is trained once and used by several tests.
const Trained& textured(PatchMethod method, double scale) {
  static std::map<std::pair<PatchMethod, double>, Trained> known;
  const auto [entry, fresh] = known.try_emplace({method, scale});
  if (fresh) entry->second = train_textured(method, scale);
  return entry->second;
}

const Trained& blobs(PatchMethod method = PatchMethod::kRidge) {
  static std::map<PatchMethod, Trained> known;
  const auto [entry, fresh] = known.try_emplace(method);
  if (fresh) entry->second = train_blobs(method);
  return entry->second;
}

// Subpixel peak, by parabolas through the maximum.
Eigen::Vector2d peak_of(const cv::Mat& response) {
  cv::Point at;
  cv::minMaxLoc(response, nullptr, nullptr, nullptr, &at);
  const auto offset = [](float left, float middle, float right) {
    const double curve = static_cast<double>(left - 2 * middle + right);
    return curve < 0 ? 0.5 * static_cast<double>(left - right) / curve : 0;
  };
  Eigen::Vector2d peak(at.x, at.y);
  if (at.x > 0 && at.x < response.cols - 1)
    peak.x() += offset(response.at<float>(at.y, at.x - 1), response.at<float>(at),
                       response.at<float>(at.y, at.x + 1));
  if (at.y > 0 && at.y < response.rows - 1)
    peak.y() += offset(response.at<float>(at.y - 1, at.x), response.at<float>(at),
                       response.at<float>(at.y + 1, at.x));
  return peak;
}

class PatchBias : public testing::TestWithParam<PatchMethod> {};

// Windows of held-out faces, sampled from the formula with the point exactly in the middle. A
// half-pixel error anywhere in training moves the peak off the middle.
TEST_P(PatchBias, ResponsePeaksAreUnbiased) {
  for (const double scale : {0.8, 1.7}) {
    const Trained& model = textured(GetParam(), scale);
    Rng rng(5);
    const Texture texture(rng.fork(1));
    rng = Rng(77);
    const int half = 9;
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    double worst = 0;
    int count = 0;
    for (int k = 0; k < 20; ++k) {
      // From the patches' frame to the texture: turned and shifted by parts of a pixel.
      const Eigen::Matrix2Xd points = random_similarity(rng, 1)(face_points());
      const Similarity2d photo_from_frame = shape::fit_similarity(model.patches.reference, points);
      const Similarity2d face_from_photo = shape::fit_similarity(points, face_points());
      for (int i = 0; i < model.patches.points(); ++i) {
        cv::Mat window(2 * half + 1, 2 * half + 1, CV_32FC1);
        for (int y = -half; y <= half; ++y) {
          for (int x = -half; x <= half; ++x) {
            const Eigen::Vector2d at =
                points.col(i) + Eigen::Vector2d(photo_from_frame.a * x - photo_from_frame.b * y,
                                                photo_from_frame.b * x + photo_from_frame.a * y);
            window.at<float>(y + half, x + half) =
                static_cast<float>(texture.at(face_from_photo(at)));
          }
        }
        const cv::Mat response =
            patch_response(model.patches.patches[static_cast<std::size_t>(i)], window);
        const int middle = response.cols / 2;
        const Eigen::Vector2d off = peak_of(response) - Eigen::Vector2d(middle, middle);
        sum += off;
        worst = std::max(worst, off.norm());
        ++count;
      }
    }
    sum /= count;
    EXPECT_NEAR(sum.x(), 0, 0.05) << "images of scale " << scale;
    EXPECT_NEAR(sum.y(), 0, 0.05) << "images of scale " << scale;
    EXPECT_LT(worst, 1.2);
  }
}

// The same for the whole fit, with its warps and downscaling.
TEST_P(PatchBias, FitsAreUnbiased) {
  for (const double scale : {0.8, 1.7}) {
    const Trained& model = textured(GetParam(), scale);
    Rng rng(5);
    const Texture texture(rng.fork(1));
    rng = Rng(78);
    for (const PatchTarget target : {PatchTarget::kPeak, PatchTarget::kMeanShift}) {
      PatchFitOptions options;
      options.target = target;
      PatchWorkspace workspace;
      Eigen::Vector2d sum = Eigen::Vector2d::Zero();
      double distance = 0;
      int count = 0;  // a diverged fit does not show bias
      for (int k = 0; k < 10; ++k) {
        const TrainingFace face = textured_face(rng, texture, scale);
        Eigen::Matrix2Xd start = face.points;
        start.row(0).array() += rng.uniform(-2, 2) * scale;
        start.row(1).array() += rng.uniform(-2, 2) * scale;
        const PatchFit fit =
            fit_patches(model.patches, model.shape, options, face.gray, start, workspace);
        if (mean_distance(fit.points, face.points) > 1.5 * scale) continue;
        ++count;
        sum += (fit.points - face.points).rowwise().mean() / scale;
        distance += mean_distance(fit.points, face.points) / scale;
      }
      ASSERT_GE(count, 8) << "images of scale " << scale;
      sum /= count;
      EXPECT_NEAR(sum.x(), 0, 0.05) << "images of scale " << scale;
      EXPECT_NEAR(sum.y(), 0, 0.05) << "images of scale " << scale;
      EXPECT_LT(distance / count, 0.5) << "images of scale " << scale;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, PatchBias,
                         testing::Values(PatchMethod::kStochastic, PatchMethod::kRidge,
                                         PatchMethod::kAverage),
                         [](const auto& param) {
                           return param.param == PatchMethod::kRidge     ? "Ridge"
                                  : param.param == PatchMethod::kAverage ? "Average"
                                                                         : "Stochastic";
                         });

TEST(PatchResponse, IsOneAtThePatchAndZeroOnUniformAreas) {
  Rng rng(3);
  cv::Mat window(21, 25, CV_32FC1);
  for (auto it = window.begin<float>(); it != window.end<float>(); ++it)
    *it = static_cast<float>(rng.uniform(10, 240));
  cv::Mat patch(7, 7, CV_32FC1);
  for (int y = 0; y < 7; ++y)
    for (int x = 0; x < 7; ++x) patch.at<float>(y, x) = std::log1p(window.at<float>(y + 5, x + 12));
  patch -= cv::mean(patch);
  patch /= cv::norm(patch);
  const cv::Mat response = patch_response(patch, window);
  EXPECT_EQ(response.size(), cv::Size(19, 15));
  EXPECT_NEAR(response.at<float>(5, 12), 1, 1e-5);
  double min_response = 0;
  double max_response = 0;
  cv::Point at;
  cv::minMaxLoc(response, &min_response, &max_response, nullptr, &at);
  EXPECT_EQ(at, cv::Point(12, 5));
  EXPECT_GE(min_response, -1);
  // Compares one position with the direct definition.
  cv::Mat part;
  cv::log(window(cv::Rect(3, 2, 7, 7)) + 1, part);
  part -= cv::mean(part);
  EXPECT_NEAR(static_cast<double>(response.at<float>(2, 3)), patch.dot(part) / cv::norm(part),
              1e-4);

  EXPECT_EQ(cv::norm(patch_response(patch, cv::Mat(15, 15, CV_8UC1, cv::Scalar(200)))), 0);
  EXPECT_THROW((void)patch_response(patch, cv::Mat(6, 15, CV_8UC1)), std::invalid_argument);
  EXPECT_THROW((void)patch_response(patch, cv::Mat(15, 15, CV_8UC3)), std::invalid_argument);
}

TEST(PatchFit, RecoversAKnownShape) {
  const Trained& model = blobs();
  Rng rng(31);
  PatchWorkspace workspace;
  for (const double opening : {-4.0, 6.0, 15.0}) {
    const TrainingFace face = blob_face(rng, opening);
    // The start has the mean's mouth.
    const Eigen::Matrix2Xd start =
        shape::fit_similarity(model.shape.mean, face.points)(model.shape.mean);
    PatchFitOptions options;
    // Two points that far from the mean look like outliers.
    options.robust = opening < 10;
    const PatchFit fit =
        fit_patches(model.patches, model.shape, options, face.gray, start, workspace);
    EXPECT_LT(mean_distance(fit.points, face.points), 0.8) << "mouth opened by " << opening;
    EXPECT_GT(fit.peaks.minCoeff(), 0.3);
    EXPECT_NEAR(fit.score, fit.peaks.mean(), 1e-12);
  }
}

TEST(PatchFit, ConvergesFromAShiftOfATenthOfTheFace) {
  for (const PatchMethod method : {PatchMethod::kRidge, PatchMethod::kStochastic}) {
    const Trained& model = blobs(method);
    Rng rng(32);
    PatchWorkspace workspace;
    for (const PatchTarget target : {PatchTarget::kPeak, PatchTarget::kMeanShift}) {
      PatchFitOptions options;
      options.target = target;
      options.search = {31, 15, 9};
      for (int k = 0; k < 8; ++k) {
        const TrainingFace face = blob_face(rng, 5);
        const double angle = k * std::numbers::pi / 4;
        const double width = face.points.row(0).maxCoeff() - face.points.row(0).minCoeff();
        const Eigen::Vector2d shift =
            0.1 * width * Eigen::Vector2d(std::cos(angle), std::sin(angle));
        const PatchFit fit = fit_patches(model.patches, model.shape, options, face.gray,
                                         face.points.colwise() + shift, workspace);
        EXPECT_LT(mean_distance(fit.points, face.points), 0.8) << "towards " << angle;
      }
    }
  }
}

TEST(PatchFit, HiddenPointDoesNotMoveTheOthers) {
  const Trained& model = blobs();
  Rng rng(33);
  TrainingFace face = blob_face(rng, 5);
  // A false blob beside the nose; the nose's own blob is erased.
  const Eigen::Vector2d nose = face.points.col(6);
  for (int y = -12; y <= 12; ++y) {
    for (int x = -12; x <= 22; ++x) {
      const double d = (x - 12) * (x - 12) + y * y;
      face.gray.at<std::uint8_t>(static_cast<int>(nose.y()) + y, static_cast<int>(nose.x()) + x) =
          cv::saturate_cast<std::uint8_t>(100 + 110 * std::exp(-d / 60));
    }
  }
  PatchWorkspace workspace;
  const PatchFit fit =
      fit_patches(model.patches, model.shape, {}, face.gray, face.points, workspace);
  EXPECT_LT(mean_distance(fit.points, face.points), 1);
}

TEST(PatchFit, StaysFiniteOnUniformImages) {
  const Trained& model = blobs();
  PatchWorkspace workspace;
  const cv::Mat flat(40, 60, CV_8UC1, cv::Scalar(90));
  for (const double shift : {0.0, -5000.0, 90'000.0}) {
    const Eigen::Matrix2Xd start = face_points().array() + shift;
    const PatchFit fit = fit_patches(model.patches, model.shape, {}, flat, start, workspace);
    EXPECT_TRUE(fit.points.allFinite());
    EXPECT_NEAR(fit.score, 0, 1e-6);
  }
  Eigen::Matrix2Xd broken = face_points();
  broken(0, 2) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)fit_patches(model.patches, model.shape, {}, flat, broken, workspace),
               std::invalid_argument);
  EXPECT_THROW(
      (void)fit_patches(model.patches, model.shape, {}, flat, face_points().leftCols(5), workspace),
      std::invalid_argument);
}

// A workspace that was used for other images gives the same result.
TEST(PatchFit, DoesNotDependOnTheWorkspace) {
  const Trained& model = blobs();
  PatchWorkspace used;
  const auto fitted = [&](std::size_t k, PatchWorkspace& workspace) {
    const TrainingFace& face = model.faces[k];
    return fit_patches(model.patches, model.shape, {}, face.gray, face.points, workspace).points;
  };
  (void)fitted(1, used);
  PatchWorkspace fresh;
  EXPECT_EQ(fitted(0, used), fitted(0, fresh));
}

TEST(PatchTraining, IsTheSameForAnyNumberOfThreads) {
  TARSIER_LONG_TEST();
  const int before = cv::getNumThreads();
  for (const PatchMethod method :
       {PatchMethod::kStochastic, PatchMethod::kRidge, PatchMethod::kAverage}) {
    cv::setNumThreads(1);
    const Trained one = train_blobs(method);
    cv::setNumThreads(4);
    const Trained four = train_blobs(method);
    for (std::size_t i = 0; i < one.patches.patches.size(); ++i)
      EXPECT_EQ(cv::norm(one.patches.patches[i], four.patches.patches[i], cv::NORM_INF), 0);
  }
  cv::setNumThreads(before);
}

TEST(PatchTraining, CanBeInterruptedAndRejectsInvalidInput) {
  Rng rng(1);
  std::vector<TrainingFace> faces;
  for (int k = 0; k < 4; ++k) faces.push_back(blob_face(rng, 3.0 * k));
  const shape::ShapeModel shape = shape_of_faces(faces);
  NoProgress progress;
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)train_patches(faces, shape, small_options(), progress, stop.get_token()),
               Interrupted);
  EXPECT_THROW((void)trained_patches({}, shape, small_options()), std::invalid_argument);
  PatchOptions options = small_options();
  options.patch = 10;
  EXPECT_THROW((void)trained_patches(faces, shape, options), std::invalid_argument);
  options = small_options();
  options.face_width = 20;
  EXPECT_THROW((void)trained_patches(faces, shape, options), std::invalid_argument);
  faces[2].points(0, 3) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)trained_patches(faces, shape, small_options()), std::invalid_argument);
}

TEST(PatchFile, JsonRoundTrip) {
  const Trained& model = blobs();
  const PatchModels again =
      patch_models_from_json(nlohmann::json::parse(to_json(model.patches).dump()), "m.json");
  EXPECT_EQ(again.method, model.patches.method);
  EXPECT_EQ(again.reference, model.patches.reference);
  ASSERT_EQ(again.points(), model.patches.points());
  for (std::size_t i = 0; i < again.patches.size(); ++i)
    EXPECT_EQ(cv::norm(again.patches[i], model.patches.patches[i], cv::NORM_INF), 0);
}

TEST(PatchFile, RefusesHostilePayloads) {
  const nlohmann::json good = to_json(blobs().patches);
  const auto expect_refused = [](const nlohmann::json& value, const char* word) {
    try {
      (void)patch_models_from_json(value, "m.json");
      ADD_FAILURE() << "accepted; expected: " << word;
    } catch (const ModelError& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("m.json"));
      EXPECT_THAT(error.what(), testing::HasSubstr(word));
    }
  };
  nlohmann::json bad = good;
  bad.erase("patches");
  expect_refused(bad, "patches");
  bad = good;
  bad["method"] = "magic";
  expect_refused(bad, "method");
  bad = good;
  bad["patches"]["shape"] = {8, 11, -11};
  expect_refused(bad, "patches");
  bad = good;
  bad["patches"]["shape"] = {9, 11, 11};
  expect_refused(bad, "patches");
  bad = good;
  bad["patches"] = pack(PackedArray<float>{{8, 4, 4}, std::vector<float>(8 * 16, 0)});
  expect_refused(bad, "odd");
  bad["patches"] = pack(PackedArray<float>{{8, 5, 5}, std::vector<float>(8 * 25, 9)});
  expect_refused(bad, "norm");
  bad["patches"] = pack(PackedArray<float>{{0, 5, 5}, {}});
  bad["reference"] = pack(PackedArray<double>{{0, 2}, {}});
  expect_refused(bad, "reference");
  bad = good;
  bad["reference"] = pack(PackedArray<double>{{8, 2}, std::vector<double>(16, 1e9)});
  expect_refused(bad, "reference");
  bad["reference"] = pack(PackedArray<double>{{8, 2}, std::vector<double>(16, 0)});
  expect_refused(bad, "wide");
  bad = good;
  // All bits set: every number is NaN.
  std::string text = bad["patches"]["data"];
  for (std::size_t k = 0; k + 4 < text.size(); ++k) text[k] = '/';
  bad["patches"]["data"] = text;
  expect_refused(bad, "patches");
  expect_refused(nlohmann::json::array(), "m.json");
}

TEST(PatchImages, ShowAllPatchesAndFrameOne) {
  const Trained& model = blobs();
  const cv::Mat all = draw_patches(model.patches, model.shape, -1, 3);
  const cv::Mat one = draw_patches(model.patches, model.shape, 4, 3);
  ASSERT_EQ(all.size(), one.size());
  EXPECT_EQ(all.type(), CV_8UC3);
  cv::Mat changed;
  cv::absdiff(all, one, changed);
  cv::Mat flat;
  cv::transform(changed, flat, cv::Matx13f(1, 1, 1));
  // Only the framed patch differs, and it is around its point.
  const cv::Rect box = cv::boundingRect(flat);
  EXPECT_NEAR(box.width, 33, 4);
  EXPECT_NEAR(box.x + box.width / 2.0,
              (model.patches.reference(0, 4) - model.patches.reference.row(0).minCoeff() + 8) * 3,
              2);
  EXPECT_THROW((void)draw_patches(model.patches, model.shape, 8, 3), std::invalid_argument);
  const cv::Mat sheet =
      draw_responses(model.patches, model.faces[0].gray, model.faces[0].points, 15);
  EXPECT_EQ(sheet.type(), CV_8UC3);
  EXPECT_GT(sheet.cols, 200);
  EXPECT_THROW(
      (void)draw_responses(model.patches, model.faces[0].gray, face_points().leftCols(3), 15),
      std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::regression
