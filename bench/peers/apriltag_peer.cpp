// SPDX-License-Identifier: MIT
// tarsier_peer_apriltag TRUTH.jsonl [DECIMATE]
// Runs the AprilTag library (family 36h11, one thread) on the images of a truth file of `ar synth
// markers`. Prints the lines that `ar eval --results` reads: corners and the library's own pose.
// "ms" is processor time of one thread, detection and poses together.
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>

#include <apriltag/apriltag.h>
#include <apriltag/apriltag_pose.h>
#include <apriltag/tag36h11.h>
#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string>

namespace {

using nlohmann::json;

double cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

// The library's coordinates refer to pixel corners, and its tags are upside down: x to the left, y
// up, z away from the reader. Ours have x to the right, y up and z towards the reader.
json found_tag(apriltag_detection_t* tag, const json& truth) {
  json corners = json::array();
  constexpr std::size_t kFirst = 5;
  for (std::size_t k = 0; k < 4; ++k) {
    const double* corner = tag->p[(kFirst - k) % 4];
    corners.push_back({corner[0] - 0.5, corner[1] - 0.5});
  }
  json out = {{"id", tag->id}, {"corners", std::move(corners)}};
  const json& k = truth.at("K");
  apriltag_detection_info_t info{tag,
                                 truth.at("size").get<double>(),
                                 k.at(0).get<double>(),
                                 k.at(4).get<double>(),
                                 k.at(2).get<double>() + 0.5,
                                 k.at(5).get<double>() + 0.5};
  apriltag_pose_t pose{};
  estimate_tag_pose(&info, &pose);
  if (pose.R == nullptr || pose.t == nullptr) return out;
  cv::Matx33d rotation;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      rotation(row, column) = (column == 1 ? 1 : -1) * MATD_EL(pose.R, static_cast<unsigned>(row),
                                                               static_cast<unsigned>(column));
  cv::Vec3d rvec;
  cv::Rodrigues(rotation, rvec);
  out["rvec"] = {rvec[0], rvec[1], rvec[2]};
  out["tvec"] = {MATD_EL(pose.t, 0, 0), MATD_EL(pose.t, 1, 0), MATD_EL(pose.t, 2, 0)};
  // A matrix is one block of calloc(); the library does not export its own function to free it.
  std::free(pose.R);
  std::free(pose.t);
  return out;
}

int run(const std::string& path, float decimate) {
  std::ifstream lines(path);
  if (!lines) {
    std::cerr << path << ": cannot be read\n";
    return 3;
  }
  apriltag_family_t* family = tag36h11_create();
  apriltag_detector_t* detector = apriltag_detector_create();
  apriltag_detector_add_family(detector, family);
  detector->quad_decimate = decimate;
  detector->nthreads = 1;
  std::string line;
  while (std::getline(lines, line)) {
    const json truth = json::parse(line);
    if (truth.value("family", "").find("36h11") == std::string::npos) continue;
    const std::string image = truth.at("image").get<std::string>();
    cv::Mat gray = cv::imread((std::filesystem::path(path).parent_path() / image).string(),
                              cv::IMREAD_GRAYSCALE);
    if (gray.empty()) {
      std::cerr << image << ": cannot be read\n";
      return 3;
    }
    const double start = cpu_ms();
    image_u8_t pixels{gray.cols, gray.rows, static_cast<std::int32_t>(gray.step[0]), gray.data};
    zarray_t* found = apriltag_detector_detect(detector, &pixels);
    json markers = json::array();
    for (int i = 0; i < zarray_size(found); ++i) {
      apriltag_detection_t* tag = nullptr;
      zarray_get(found, i, static_cast<void*>(&tag));
      markers.push_back(found_tag(tag, truth));
    }
    apriltag_detections_destroy(found);
    const double ms = cpu_ms() - start;
    std::cout << json{{"image", image}, {"markers", markers}, {"ms", ms}}.dump() << '\n';
  }
  apriltag_detector_destroy(detector);
  tag36h11_destroy(family);
  return 0;
}

}  // namespace

int main(int count, char** words) {
  if (count < 2 || count > 3) {
    std::cerr << "usage: tarsier_peer_apriltag TRUTH.jsonl [DECIMATE]\n";
    return 2;
  }
  try {
    return run(words[1], count == 3 ? std::strtof(words[2], nullptr) : 1);
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 3;
  }
}
