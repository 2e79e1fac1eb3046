// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/predefined.h"

#include "tarsier/core/require.h"

#include <opencv2/core/version.hpp>

#define TARSIER_NEW_ARUCO (CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 407)
#if TARSIER_NEW_ARUCO
#include <opencv2/objdetect/aruco_detector.hpp>
#else
#include <opencv2/aruco.hpp>
#endif

#include <array>
#include <optional>

namespace tarsier::planar::markers {
namespace {

struct Entry {
  std::string_view name;
  int number;
};

constexpr std::array<Entry, 21> kEntries{{
    {"aruco-original", cv::aruco::DICT_ARUCO_ORIGINAL},
    {"4x4_50", cv::aruco::DICT_4X4_50},
    {"4x4_100", cv::aruco::DICT_4X4_100},
    {"4x4_250", cv::aruco::DICT_4X4_250},
    {"4x4_1000", cv::aruco::DICT_4X4_1000},
    {"5x5_50", cv::aruco::DICT_5X5_50},
    {"5x5_100", cv::aruco::DICT_5X5_100},
    {"5x5_250", cv::aruco::DICT_5X5_250},
    {"5x5_1000", cv::aruco::DICT_5X5_1000},
    {"6x6_50", cv::aruco::DICT_6X6_50},
    {"6x6_100", cv::aruco::DICT_6X6_100},
    {"6x6_250", cv::aruco::DICT_6X6_250},
    {"6x6_1000", cv::aruco::DICT_6X6_1000},
    {"7x7_50", cv::aruco::DICT_7X7_50},
    {"7x7_100", cv::aruco::DICT_7X7_100},
    {"7x7_250", cv::aruco::DICT_7X7_250},
    {"7x7_1000", cv::aruco::DICT_7X7_1000},
    {"16h5", cv::aruco::DICT_APRILTAG_16h5},
    {"25h9", cv::aruco::DICT_APRILTAG_25h9},
    {"36h10", cv::aruco::DICT_APRILTAG_36h10},
    {"36h11", cv::aruco::DICT_APRILTAG_36h11},
}};

std::optional<int> number_of(std::string_view name) {
  for (const Entry& entry : kEntries)
    if (entry.name == name) return entry.number;
  return std::nullopt;
}

#if TARSIER_NEW_ARUCO
using OpencvDictionary = cv::aruco::Dictionary;
OpencvDictionary opencv_dictionary(int number) {
  return cv::aruco::getPredefinedDictionary(number);
}
const OpencvDictionary& reference(const OpencvDictionary& dictionary) { return dictionary; }
#else
using OpencvDictionary = cv::Ptr<cv::aruco::Dictionary>;
OpencvDictionary opencv_dictionary(int number) {
  return cv::aruco::getPredefinedDictionary(number);
}
const cv::aruco::Dictionary& reference(const OpencvDictionary& dictionary) { return *dictionary; }
#endif

}  // namespace

PredefinedCodes predefined_codes(std::string_view name) {
  const auto number = number_of(name);
  if (!number) return {};
  const OpencvDictionary dictionary = opencv_dictionary(*number);
  const auto& table = reference(dictionary);
  PredefinedCodes result;
  result.cells = table.markerSize;
  for (int id = 0; id < table.bytesList.rows; ++id) {
    const cv::Mat bits =
        cv::aruco::Dictionary::getBitsFromByteList(table.bytesList.row(id), table.markerSize);
    Code code = 0;
    for (int y = 0; y < bits.rows; ++y)
      for (int x = 0; x < bits.cols; ++x) code = code << 1U | (bits.at<uchar>(y, x) != 0 ? 1U : 0U);
    result.codes.push_back(code);
  }
  return result;
}

std::vector<Marker> detect_with_opencv(const cv::Mat& image, std::string_view name) {
  const auto number = number_of(name);
  TARSIER_REQUIRE(number.has_value(), "{} is not a family that OpenCV knows", name);
  const OpencvDictionary dictionary = opencv_dictionary(*number);
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<int> ids;
#if TARSIER_NEW_ARUCO
  cv::aruco::DetectorParameters parameters;
  parameters.cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
  cv::aruco::ArucoDetector(dictionary, parameters).detectMarkers(image, corners, ids);
#else
  const auto parameters = cv::aruco::DetectorParameters::create();
  parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
  cv::aruco::detectMarkers(image, dictionary, corners, ids, parameters);
#endif
  std::vector<Marker> markers;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (corners[i].size() != 4) continue;
    Marker& marker = markers.emplace_back();
    marker.id = ids[i];
    for (std::size_t k = 0; k < 4; ++k)
      marker.corners[k] = {double{corners[i][k].x}, double{corners[i][k].y}};
  }
  return markers;
}

}  // namespace tarsier::planar::markers
