// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/dense_reconstructor.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/dense/dense_evaluation.h"
#include "tarsier/sfm/dense/point_grid.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/synth/sfm_scene.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <stop_token>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::HasSubstr;

// Stops after a number of images of one stage.
class StopAfter final : public Progress {
 public:
  StopAfter(std::string stage, int images) : stage_(std::move(stage)), left_(images) {}
  void begin(std::string_view stage, std::int64_t, std::string_view) override { now_ = stage; }
  void advance(std::int64_t) override {
    if (now_ == stage_ && --left_ == 0) source.request_stop();
  }
  void end() override {}
  std::stop_source source;

 private:
  std::string stage_;
  std::string now_;
  int left_;
};

class DenseTest : public FolderTest {
 protected:
  DenseTest() : scene_(scene_options()) {
    fs::create_directories(path("images"));
    job_.folder = path("dense");
    job_.path_of = [this](const std::string& name) { return path("images/" + name); };
    job_.model.cameras.push_back(scene_.camera());
    for (int i = 0; i < scene_.count(); ++i) {
      Image image;
      image.name = fmt::format("{}.png", i);
      image.registered = true;
      image.pose = scene_.pose(i);
      write_image(path("images/" + image.name), scene_.render(i));
      job_.model.images.push_back(image);
    }
    add_points();
  }
  static synth::SceneOptions scene_options() {
    synth::SceneOptions options;
    options.size = {200, 150};
    options.images = 4;
    options.noise = 1;
    return options;
  }
  // Points of the surface, observed by all images that have them in view.
  void add_points() {
    const geometry::Camera& camera = job_.model.cameras[0];
    for (int v = 5; v < camera.height; v += 12) {
      for (int u = 5; u < camera.width; u += 12) {
        const auto depth = scene_.depth(1, cv::Point2d(u, v));
        if (!depth) continue;
        Point point;
        point.position = scene_.pose(1).inverse() *
                         Eigen::Vector3d((u - camera.cx) / camera.fx * *depth,
                                         (v - camera.cy) / camera.fy * *depth, *depth);
        for (int i = 0; i < scene_.count(); ++i) {
          const auto pixel = camera.project(scene_.pose(i) * point.position);
          if (!pixel || pixel->x < 0 || pixel->y < 0 || pixel->x > camera.width - 1 ||
              pixel->y > camera.height - 1)
            continue;
          Image& image = job_.model.images[static_cast<std::size_t>(i)];
          point.track.push_back({i, static_cast<int>(image.features.size())});
          image.features.emplace_back(static_cast<float>(pixel->x), static_cast<float>(pixel->y));
          image.points.push_back(static_cast<int>(job_.model.points.size()));
        }
        if (point.track.size() >= 2) {
          job_.model.points.push_back(point);
        } else {
          for (const Observation& seen : point.track)
            job_.model.images[static_cast<std::size_t>(seen.image)].points.back() = -1;
        }
      }
    }
  }
  static DenseOptions options() {
    DenseOptions options = dense_options(DenseQuality::kNormal);
    options.reduce = 1;
    return options;
  }
  DenseResult run(const DenseOptions& with = options()) {
    NoProgress progress;
    return DenseReconstructor(with).run(job_, progress, {});
  }
  std::string error_of_run() {
    try {
      (void)run();
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  }
  // A workspace with exact depths.
  void write_truth() {
    Model model = job_.model;
    write_colmap(path("truth/sparse"), model);
    const Workspace truth = Workspace::open(path("truth"));
    for (int i = 0; i < truth.count(); ++i) {
      DepthMap map;
      map.depth = cv::Mat1f(150, 200, 0.F);
      for (int y = 0; y < 150; ++y)
        for (int x = 0; x < 200; ++x)
          map.depth.at<float>(y, x) =
              static_cast<float>(scene_.depth(i, cv::Point2d(x, y)).value_or(0));
      truth.write_depth_map(i, map);
    }
  }

  synth::SfmScene scene_;
  DenseJob job_;
};

TEST_F(DenseTest, MakesDepthsAndACloudOfASyntheticScene) {
  const DenseResult result = run();
  ASSERT_EQ(result.images.size(), 4U);
  for (const DenseImage& image : result.images) {
    EXPECT_EQ(image.reason, "");
    EXPECT_GE(image.sources.size(), 2U);
    EXPECT_GT(image.known, 0.5) << image.name;
    EXPECT_LT(image.median_cost, 0.3);
  }
  EXPECT_GT(result.points, 20'000);
  EXPECT_EQ(static_cast<std::int64_t>(read_cloud(result.cloud).size()), result.points);
  for (const char* file : {"dense.json", "stereo/patch-match.cfg", "stereo/fusion.cfg",
                           "stereo/depth_maps/0.png.photometric.bin",
                           "stereo/normal_maps/0.png.geometric.bin", "stereo/confidence/0.png.bin"})
    EXPECT_TRUE(fs::exists(fs::path(job_.folder) / file)) << file;

  write_truth();
  NoProgress progress;
  int shown = 0;
  const DenseScores scores =
      evaluate_dense(Workspace::open(path("truth")), Workspace::open(job_.folder),
                     [&](const std::string&, const cv::Mat& image) {
                       EXPECT_EQ(image.size(), cv::Size(200, 150));
                       ++shown;
                     },
                     progress, {});
  EXPECT_EQ(shown, 4);
  EXPECT_LT(scores.depth_median, 0.003);
  ASSERT_EQ(scores.cloud.size(), 3U);
  EXPECT_GT(scores.cloud[1].accuracy, 0.75);
  EXPECT_GT(scores.cloud[1].f1, 0.8);
}

TEST_F(DenseTest, NormalsPointOutOfTheSurface) {
  (void)run();
  const std::vector<CloudPoint> points = read_cloud(path("dense/fused.ply"));
  double along = 0;
  for (const CloudPoint& point : points) along += point.normal[2];
  // The cameras stand at z > 0.
  EXPECT_GT(along / static_cast<double>(points.size()), 0.5);
}

TEST_F(DenseTest, ThreadsDoNotChangeTheFiles) {
  TARSIER_LONG_TEST();
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  (void)run();
  const std::string one = read_file(path("dense/fused.ply"), 100'000'000);
  fs::remove_all(job_.folder);
  cv::setNumThreads(3);
  (void)run();
  cv::setNumThreads(threads);
  EXPECT_TRUE(read_file(path("dense/fused.ply"), 100'000'000) == one);
}

TEST_F(DenseTest, ResumesAfterAStop) {
  TARSIER_LONG_TEST();
  (void)run();
  const std::string uninterrupted = read_file(path("dense/fused.ply"), 100'000'000);
  fs::remove_all(job_.folder);
  for (const char* stage : {"match", "compare"}) {
    StopAfter progress(stage, 2);
    EXPECT_THROW(
        (void)DenseReconstructor(options()).run(job_, progress, progress.source.get_token()),
        Interrupted);
    EXPECT_FALSE(fs::exists(path("dense/fused.ply")));
  }
  const auto first = fs::last_write_time(path("dense/stereo/depth_maps/0.png.geometric.bin"));
  const DenseResult result = run();
  EXPECT_TRUE(result.images[0].is_reused);
  EXPECT_FALSE(result.images[3].is_reused);
  EXPECT_EQ(fs::last_write_time(path("dense/stereo/depth_maps/0.png.geometric.bin")), first);
  EXPECT_TRUE(read_file(path("dense/fused.ply"), 100'000'000) == uninterrupted);
}

TEST_F(DenseTest, WhatIsBeingOverwrittenHasNoRecord) {
  DenseOptions fast = options();
  fast.reduce = 4;
  fast.min_side = 64;
  (void)run(fast);
  const std::string sparse = read_file(path("dense/sparse/images.txt"), 1'000'000);
  // Stopped while another model replaces the first one.
  const Model model = job_.model;
  for (Image& image : job_.model.images) image.pose.translation *= 2;
  for (Point& point : job_.model.points) point.position *= 2;
  StopAfter progress("undistort", 1);
  EXPECT_THROW((void)DenseReconstructor(fast).run(job_, progress, progress.source.get_token()),
               Interrupted);
  EXPECT_NE(read_file(path("dense/sparse/images.txt"), 1'000'000), sparse);
  job_.model = model;
  (void)run(fast);
  EXPECT_EQ(read_file(path("dense/sparse/images.txt"), 1'000'000), sparse);

  // Maps that cannot be written completely.
  DenseOptions other_filter = fast;
  other_filter.filter.max_cost = 0.3;
  DenseOptions other_seed = fast;
  other_seed.seed = 7;
  for (const auto& [kind, changed] :
       {std::pair("geometric", other_filter), std::pair("photometric", other_seed)}) {
    SCOPED_TRACE(kind);
    const std::string record = path(fmt::format("dense/stereo/state/0.png.{}.json", kind));
    const std::string map = path(fmt::format("dense/stereo/depth_maps/0.png.{}.bin", kind));
    ASSERT_TRUE(fs::exists(record));
    fs::remove(map);
    fs::create_directory(map);
    EXPECT_THROW((void)run(changed), OutputError);
    EXPECT_FALSE(fs::exists(record));
    fs::remove(map);
    (void)run(fast);
  }
}

TEST_F(DenseTest, FileNamesNeedNotBeUtf8) {
  DenseOptions fast = options();
  fast.reduce = 4;
  fast.min_side = 64;
  const std::string name = "caf\xE9.png";
  fs::rename(path("images/0.png"), path("images/" + name));
  job_.model.images[0].name = name;
  EXPECT_EQ(run(fast).images[0].name, name);
  const auto json = nlohmann::json::parse(read_file(path("dense/dense.json"), 1'000'000));
  EXPECT_EQ(json["images"][0]["name"], "caf\xEF\xBF\xBD.png");
}

TEST_F(DenseTest, CoordinatesBeyondSinglePrecisionAreRefusedBeforeTheWork) {
  geometry::Sim3 utm;
  utm.translation = {500'123, 4'649'776, 120};
  Model far = job_.model;
  transform(far, utm);
  // One wrong camera is no reason.
  job_.model.images[0].pose = far.images[0].pose;
  EXPECT_NO_THROW(check_coordinates(job_.model));
  job_.model = far;
  EXPECT_THAT(error_of_run(), HasSubstr("the coordinates of the model are too large"));
  EXPECT_FALSE(fs::exists(job_.folder));
}

TEST_F(DenseTest, OtherOptionsOrImagesAreRecomputed) {
  TARSIER_LONG_TEST();
  (void)run();
  DenseOptions other = options();
  other.filter.max_cost = 0.3;
  DenseResult result = run(other);
  EXPECT_FALSE(result.images[0].is_reused);
  result = run(other);
  EXPECT_TRUE(result.images[0].is_reused);
  write_image(path("images/2.png"), scene_.render(1));
  result = run(other);
  EXPECT_FALSE(result.images[0].is_reused);
}

TEST_F(DenseTest, AnImageWithoutSharedPointsIsReported) {
  Image& lost = job_.model.images[3];
  for (Point& point : job_.model.points)
    std::erase_if(point.track, [](const Observation& seen) { return seen.image == 3; });
  lost.features.clear();
  lost.points.clear();
  // Tracks of a single image do not count.
  Model& model = job_.model;
  std::vector<Point> remaining;
  std::vector<int> new_index(model.points.size(), -1);
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    if (model.points[p].track.size() < 2) continue;
    new_index[p] = static_cast<int>(remaining.size());
    remaining.push_back(model.points[p]);
  }
  model.points = remaining;
  for (Image& image : model.images)
    for (int& point : image.points)
      if (point >= 0) point = new_index[static_cast<std::size_t>(point)];
  const DenseResult result = run();
  EXPECT_THAT(result.images[3].reason, HasSubstr("observes no point of the model"));
  EXPECT_EQ(result.images[0].reason, "");
  EXPECT_THAT(summary_text(result), HasSubstr("left out: 3.png"));
  EXPECT_EQ(to_json(result)["images"][3]["reason"], result.images[3].reason);
  EXPECT_GT(result.points, 1000);
}

TEST_F(DenseTest, ErrorsNameTheCause) {
  const DenseJob job = job_;
  job_.model.images.resize(1);
  job_.model.points.clear();
  job_.model.images[0].points.assign(job_.model.images[0].points.size(), -1);
  EXPECT_THAT(error_of_run(), HasSubstr("two or more"));
  job_ = job;
  for (Image& image : job_.model.images) image.pose = job_.model.images[0].pose;
  EXPECT_THAT(error_of_run(), HasSubstr("from the same position as the others"));
  job_ = job;
  fs::remove(path("images/1.png"));
  EXPECT_THAT(error_of_run(), HasSubstr("1.png"));
  write_image(path("images/1.png"), cv::Mat(30, 40, CV_8UC3, cv::Scalar(1, 2, 3)));
  EXPECT_THAT(error_of_run(), HasSubstr("40x30"));
  job_.model.points[0].position[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)run(), std::invalid_argument);
}

TEST_F(DenseTest, AWrongRangeOfDepthsLeavesAnEmptyCloud) {
  DenseOptions wrong = options();
  wrong.min_depth = 500;
  wrong.max_depth = 1000;
  const DenseResult result = run(wrong);
  EXPECT_LT(result.points, 200);
}

TEST_F(DenseTest, AMemoryLimitReducesTheMaps) {
  DenseOptions tiny = options();
  tiny.memory_gb = 0.25;
  tiny.views.views = 3;
  EXPECT_EQ(run(tiny).images[0].size, cv::Size(200, 150));  // this size is enough for these images
  tiny.memory_gb = 0.1;
  EXPECT_THROW(DenseReconstructor{tiny}, std::invalid_argument);
}

TEST_F(DenseTest, SelectsViewsByAngleAndEstimatesTheDepthRange) {
  ViewSelectionOptions options;
  const std::vector<ViewChoice> choices = select_views(job_.model, options);
  ASSERT_EQ(choices.size(), 4U);
  EXPECT_NEAR(choices[1].sources[0].angle_deg, 7, 3);  // a neighbour on the arc
  EXPECT_LT(choices[1].min_depth, 9);
  EXPECT_GT(choices[1].max_depth, 10);
  options.views = 2;
  EXPECT_EQ(select_views(job_.model, options)[0].sources.size(), 2U);
  options.max_angle_deg = 9;
  const std::vector<ViewChoice> narrow = select_views(job_.model, options);
  for (const ViewChoice::Source& source : narrow[0].sources) EXPECT_EQ(source.image, 1);
}

TEST(PointGrid, FindsTheNearestPoint) {
  Rng rng(5);
  std::vector<cv::Vec3f> points;
  const auto any = [&] {
    return cv::Vec3f(static_cast<float>(rng.uniform(-1, 1)), static_cast<float>(rng.uniform(-1, 1)),
                     static_cast<float>(rng.uniform(-1, 1)));
  };
  for (int i = 0; i < 300; ++i) points.push_back(any());
  const PointGrid grid(points, 0.05F);
  for (int i = 0; i < 200; ++i) {
    const cv::Vec3f from = any();
    float best = 0.4F;
    for (const cv::Vec3f& point : points)
      best = std::min(best, static_cast<float>(cv::norm(point - from)));
    EXPECT_NEAR(grid.distance(from, 0.4F), best, 1e-5);
  }
  EXPECT_EQ(voxel_downsampled({{0, 0, 0}, {0.1F, 0, 0}, {1.5F, 0, 0}}, 1).size(), 2U);
}

}  // namespace
}  // namespace tarsier::sfm
