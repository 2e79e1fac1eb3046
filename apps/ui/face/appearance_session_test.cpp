// SPDX-License-Identifier: MIT
#include "ui/face/appearance_session.h"

#include "tarsier/core/progress.h"
#include "tarsier/face/appearance/testing_portraits.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

namespace tarsier {
namespace {

class AppearanceSessionTest : public ::testing::Test {
 protected:
  AppearanceSessionTest() {
    frame_.image = unseen_.image;
    frame_.name = "image";
    frame_.still = true;
  }
  static const face::AppearanceTracker& tracker() {
    static const face::AppearanceTracker result = [] {
      NoProgress silent;
      const TemporaryFolder folder;
      face::AppearanceTrackerOptions options;
      options.model = folder / "model.json";
      face::appearance::write_appearance_model(
          options.model,
          face::appearance::train_appearance_model(face::appearance::test_support::portraits(30, 1),
                                                   {}, {}, silent, {}),
          nlohmann::json::object());
      return face::AppearanceTracker::load({}, options);
    }();
    return result;
  }
  AppearanceSession session() {
    face::AppearanceState state;
    state.find = [this](const cv::Mat&) {
      const Eigen::Matrix2Xd& mean = tracker().model().shape.mean;
      return std::vector<std::vector<Eigen::Matrix2Xd>>{
          {face::shape::fit_similarity(mean, unseen_.points)(mean)}};
    };
    return {tracker(), AppearanceSession::Overlay::kMesh, nullptr, std::move(state)};
  }

  face::appearance::TrainingImage unseen_ = face::appearance::test_support::portraits(1, 33)[0];
  Frame frame_;
};

TEST_F(AppearanceSessionTest, FitsAndDraws) {
  AppearanceSession session = this->session();
  const View view = session.on_frame(frame_, {});
  ASSERT_EQ(session.objects().size(), 1U);
  EXPECT_LT((session.objects()[0].fit.points - unseen_.points).colwise().norm().mean(), 1.0);
  EXPECT_EQ(view.state["faces"], 1);
  EXPECT_GT(cv::norm(view.output, unseen_.image, cv::NORM_L1), 0);
}

TEST_F(AppearanceSessionTest, KeySwitchesWhatIsDrawn) {
  AppearanceSession session = this->session();
  (void)session.on_frame(frame_, {});
  std::vector<std::string> drawn;
  for (int i = 0; i < 4; ++i) {
    const View view = session.on_event(key_event('v'));
    drawn.push_back(view.state["drawn"]);
    if (drawn.back() == "nothing") {
      EXPECT_EQ(cv::norm(view.output, unseen_.image, cv::NORM_INF), 0);
    }
  }
  EXPECT_EQ(drawn, (std::vector<std::string>{"face", "points", "nothing", "mesh"}));
}

TEST_F(AppearanceSessionTest, TracksObjectsInVideos) {
  AppearanceSession session = this->session();
  frame_.still = false;
  (void)session.on_frame(frame_, {});
  frame_.time = 0.04;
  const View view = session.on_frame(frame_, {});
  EXPECT_TRUE(session.is_tracking());
  EXPECT_EQ(view.state["ids"], nlohmann::json::array({1}));
  EXPECT_FALSE(session.on_event(key_event('h')).finished);
  EXPECT_TRUE(session.on_event(key_event(key::kEscape)).finished);
}

}  // namespace
}  // namespace tarsier
