// SPDX-License-Identifier: MIT
// dlib's regression trees (Kazemi and Sullivan, CVPR 2014), as a baseline for `tarsier landmarks`.
//   tarsier_peer_dlib version
//   tarsier_peer_dlib train LIST MODEL TREES OVERSAMPLING THREADS
//   tarsier_peer_dlib fit MODEL LIST      points of the face in each line's "box"
//   tarsier_peer_dlib find MODEL LIST     the same, with dlib's own detector of frontal faces
// LIST: JSON lines {"image", "box": [x, y, w, h], "points": [[x, y] ..]}; points only for training.
// fit and find print the lines that `tarsier landmarks eval --results` reads; "ms" is processor
// time of one thread, for the fit alone.
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <dlib/image_processing.h>
#include <dlib/image_processing/frontal_face_detector.h>
#include <dlib/opencv.h>
#include <dlib/revision.h>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using nlohmann::json;

double cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

std::vector<json> lines_of(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error(path + ": cannot be read");
  std::vector<json> lines;
  std::string line;
  while (std::getline(file, line)) lines.push_back(json::parse(line));
  return lines;
}

cv::Mat gray_of(const json& line) {
  const std::string path = line.at("image").get<std::string>();
  cv::Mat gray = cv::imread(path, cv::IMREAD_GRAYSCALE);
  if (gray.empty()) throw std::runtime_error(path + ": cannot be read");
  return gray;
}

dlib::rectangle box_of(const json& line) {
  const auto box = line.at("box").get<std::vector<double>>();
  const long left = std::lround(box.at(0));
  const long top = std::lround(box.at(1));
  return {left, top, left + std::lround(box.at(2)) - 1, top + std::lround(box.at(3)) - 1};
}

int train(const std::string& list, const std::string& path, unsigned long trees,
          unsigned long oversampling, unsigned long threads) {
  dlib::array<dlib::array2d<unsigned char>> images;
  std::vector<std::vector<dlib::full_object_detection>> objects;
  for (const json& line : lines_of(list)) {
    const cv::Mat gray = gray_of(line);
    dlib::array2d<unsigned char> image;
    dlib::assign_image(image, dlib::cv_image<unsigned char>(gray));
    images.push_back(image);
    std::vector<dlib::point> parts;
    for (const json& point : line.at("points"))
      parts.emplace_back(std::lround(point.at(0).get<double>()),
                         std::lround(point.at(1).get<double>()));
    objects.push_back({dlib::full_object_detection(box_of(line), parts)});
  }
  // other options are dlib's defaults: depth 4, 10 cascades, nu 0.1
  dlib::shape_predictor_trainer trainer;
  trainer.set_num_trees_per_cascade_level(trees);
  trainer.set_oversampling_amount(oversampling);
  trainer.set_num_threads(threads);
  const dlib::shape_predictor model = trainer.train(images, objects);
  dlib::serialize(path) << model;
  return 0;
}

int fit(const std::string& path, const std::string& list, bool find) {
  dlib::shape_predictor model;
  dlib::deserialize(path) >> model;
  dlib::frontal_face_detector detector;
  if (find) detector = dlib::get_frontal_face_detector();
  for (const json& line : lines_of(list)) {
    const cv::Mat gray = gray_of(line);
    const dlib::cv_image<unsigned char> image(gray);
    dlib::rectangle box;
    bool found = true;
    if (find) {
      const std::vector<dlib::rectangle> boxes = detector(image);
      found = !boxes.empty();
      if (found)
        box = *std::max_element(boxes.begin(), boxes.end(),
                                [](const auto& a, const auto& b) { return a.area() < b.area(); });
    } else {
      found = line.contains("box") && !line.at("box").is_null();
      if (found) box = box_of(line);
    }
    json out = {{"image", line.at("image")}};
    json points = json::array();
    if (found) {
      const double start = cpu_ms();
      const dlib::full_object_detection shape = model(image, box);
      out["ms"] = cpu_ms() - start;
      for (unsigned long k = 0; k < shape.num_parts(); ++k)
        points.push_back({shape.part(k).x(), shape.part(k).y()});
      out["points"] = std::move(points);
    } else {
      out["faces"] = json::array();
    }
    std::cout << out.dump() << '\n';
  }
  return 0;
}

int run(const std::vector<std::string>& words) {
  if (words.size() == 1 && words[0] == "version") {
    std::cout << DLIB_MAJOR_VERSION << '.' << DLIB_MINOR_VERSION << '\n';
    return 0;
  }
  if (words.size() == 6 && words[0] == "train")
    return train(words[1], words[2], std::stoul(words[3]), std::stoul(words[4]),
                 std::stoul(words[5]));
  if (words.size() == 3 && (words[0] == "fit" || words[0] == "find"))
    return fit(words[1], words[2], words[0] == "find");
  std::cerr << "usage: tarsier_peer_dlib version | train LIST MODEL TREES OVERSAMPLING THREADS | "
               "fit MODEL LIST | find MODEL LIST\n";
  return 2;
}

}  // namespace

int main(int count, char** words) {
  try {
    return run({words + 1, words + count});
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 3;
  }
}
