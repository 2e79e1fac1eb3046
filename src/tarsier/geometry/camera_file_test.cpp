// SPDX-License-Identifier: MIT
#include "tarsier/geometry/camera_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/persistence.hpp>

#include <array>
#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::geometry {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

const std::string kTarsierFile =
    "model: pinhole\nwidth: 640\nheight: 480\nfx: 500\nfy: 501\ncx: 320\ncy: 240\n"
    "distortion: [0.1, 0, 0, 0, 0]\nrms: 0.5\n";
const std::string kOpenCvFile =
    "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n"
    "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    "   data: [ 500., 0., 320., 0., 501., 240., 0., 0., 1. ]\n"
    "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
    "   data: [ 0.1, 0.2, 0.3, 0.4, 0.5 ]\n"
    "avg_reprojection_error: 0.25\n";

std::string replaced(std::string text, const std::string& old_text, const std::string& new_text) {
  const std::size_t position = text.find(old_text);
  EXPECT_NE(position, std::string::npos) << old_text;
  return text.replace(position, old_text.size(), new_text);
}

class CameraFileTest : public FolderTest {
 protected:
  Camera read(const std::string& text) {
    write_file_atomically(path("camera.txt"), text);
    return read_camera_file(path("camera.txt"));
  }
  std::string refusal(const std::string& text) {
    try {
      (void)read(text);
    } catch (const InputError& error) {
      EXPECT_EQ(error.path(), path("camera.txt"));
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
      return error.what();
    }
    return "accepted";
  }
};

TEST_F(CameraFileTest, TarsierFormatRoundTripsExactly) {
  Camera camera{3072,
                2048,
                2759.48 + 1.0 / 3,
                std::sqrt(2.0) * 1e3,
                M_PI * 480,
                -1e-7,
                {-0.1, 1.0 / 3, 1e-300, -0.0, 0.3},
                0.123456789012345678};
  write_camera_file(path("camera.yaml"), camera);
  const Camera read = read_camera_file(path("camera.yaml"));
  EXPECT_EQ(read.width, camera.width);
  EXPECT_EQ(read.height, camera.height);
  EXPECT_EQ(read.fx, camera.fx);
  EXPECT_EQ(read.fy, camera.fy);
  EXPECT_EQ(read.cx, camera.cx);
  EXPECT_EQ(read.cy, camera.cy);
  EXPECT_EQ(read.distortion, camera.distortion);
  EXPECT_EQ(read.rms, camera.rms);
  camera.fx = NAN;
  EXPECT_THROW(write_camera_file(path("camera.yaml"), camera), std::invalid_argument);
  EXPECT_EQ(read_camera_file(path("camera.yaml")).fy, camera.fy);
}

TEST_F(CameraFileTest, TarsierFormatMayBeWrittenByHand) {
  const Camera camera = read(
      "\xEF\xBB\xBF# mine\r\n---\r\nmodel: pinhole # the only one\r\nfx: 1e3\r\nfy:  +1000\r\n"
      "cx: 5\r\ncy: 6\r\n\r\n...\r\n");
  EXPECT_EQ(camera.fx, 1000);
  EXPECT_EQ(camera.fy, 1000);
  EXPECT_EQ(camera.width, 0);
  EXPECT_FALSE(camera.is_distorted());
}

TEST_F(CameraFileTest, ErrorsInTarsierFilesNameTheLine) {
  EXPECT_THAT(refusal(replaced(kTarsierFile, "fx: 500", "fx: nan")),
              HasSubstr("line 4: 'nan' is not a finite"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "fx: 500", "fx: 1e999")), HasSubstr("line 4"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "fx: 500", "fx:")), HasSubstr("line 4"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "fx: 500", "fx: -500")), HasSubstr("not positive"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "fx: 500", "fx: 0")), HasSubstr("not positive"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "fx: 500", "fx")), HasSubstr("line 4: 'key: value'"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "fx: 500\n", "")), HasSubstr("'fx:' is missing"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "fx: 500", "fy: 500")),
              HasSubstr("line 5: a second 'fy:'"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "fx: 500", "f\x1bx: 500")),
              AllOf(HasSubstr("\\x1b"), HasSubstr("none of model")));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "pinhole", "fischaug")), HasSubstr("'fischaug'"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "pinhole", "fisheye")),
              HasSubstr("line 8: distortion: 5 numbers, a fisheye lens has 4"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "640", "1e3")),
              HasSubstr("line 2: '1e3' is not a size"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "640", "99999999999")), HasSubstr("is not a size"));
  EXPECT_THAT(refusal(replaced(kTarsierFile, "640", "0")), HasSubstr("0x480"));
  for (const char* list : {"[]", "[0, 0, 0, 0]", "[0, 0, 0, 0, 0, 0]", "0", "[", "]", "[0 0 0 0 0]",
                           "[0, 0, inf, 0, 0]", "[,,,,]"}) {
    EXPECT_THAT(refusal(replaced(kTarsierFile, "[0.1, 0, 0, 0, 0]", list)), HasSubstr("line 8"))
        << list;
  }
}

TEST_F(CameraFileTest, ReadsOpenCvYamlAndXml) {
  const Camera yaml = read(kOpenCvFile);
  EXPECT_EQ(yaml.width, 640);
  EXPECT_EQ(yaml.height, 480);
  EXPECT_EQ(yaml.fx, 500);
  EXPECT_EQ(yaml.fy, 501);
  EXPECT_EQ(yaml.cx, 320);
  EXPECT_EQ(yaml.cy, 240);
  EXPECT_EQ(yaml.distortion, (std::array<double, 8>{0.1, 0.2, 0.3, 0.4, 0.5}));
  EXPECT_EQ(yaml.rms, 0.25);
  // Files as OpenCV writes them, with the names of its programs and tutorials.
  const std::vector<std::array<std::string, 4>> names{
      {"camera_matrix", "distortion_coefficients", "image_width", "image_height"},
      {"Camera_Matrix", "Distortion_Coefficients", "image_Width", "image_Height"},
      {"cameraMatrix", "distCoeffs", "", ""},
      {"K", "dist_coeffs", "", ""}};
  for (const std::string ending : {".yml", ".xml"}) {
    for (const auto& [matrix, distortion, width, height] : names) {
      const std::string file = path("opencv" + ending);
      {
        cv::FileStorage storage(file, cv::FileStorage::WRITE);
        storage << "calibration_time"
                << "Mon 1 Jan"
                << "flags" << 0;
        if (!width.empty()) storage << width << 640 << height << 480;
        storage << matrix << cv::Mat(cv::Matx33d(500.125, 0, 320, 0, 501, 240, 0, 0, 1))
                << distortion << cv::Mat(cv::Matx41f(0.5F, 0.25F, 0, 0.125F));
      }
      const Camera camera = read_camera_file(file);
      EXPECT_EQ(camera.fx, 500.125);
      EXPECT_EQ(camera.cy, 240);
      EXPECT_EQ(camera.width, width.empty() ? 0 : 640);
      EXPECT_EQ(camera.distortion, (std::array<double, 8>{0.5, 0.25, 0, 0.125, 0}));
    }
  }
  EXPECT_EQ(read("%YAML:1.0\n---\nK: [ 5, 0, 3, 0, 6, 4, 0, 0, 1 ]\n").fy, 6);
}

TEST_F(CameraFileTest, InvalidOpenCvFilesAreRefused) {
  const auto changed = [&](const std::string& from, const std::string& to) {
    return refusal(replaced(kOpenCvFile, from, to));
  };
  EXPECT_THAT(changed("camera_matrix", "camera_matrox"), HasSubstr("has none of camera_matrix"));
  EXPECT_THAT(changed("500.", ".Nan"), HasSubstr("not a finite number"));
  EXPECT_THAT(changed("500.", ".Inf"), HasSubstr("not a finite number"));
  EXPECT_THAT(changed("500.", "-500."), HasSubstr("not positive"));
  EXPECT_THAT(changed("500.", "abc"), HasSubstr("not a finite number"));
  EXPECT_THAT(changed("500., 0.", "500., 3."), HasSubstr("skew"));
  EXPECT_THAT(changed("0., 0., 1. ]", "0., 0., 2. ]"), HasSubstr("not a calibration matrix"));
  EXPECT_THAT(changed("0., 0., 1. ]", "0., 0. ]"), HasSubstr("rows x cols"));
  EXPECT_THAT(changed("rows: 3", "rows: 1000000000"), HasSubstr("rows x cols"));
  EXPECT_THAT(changed("rows: 3", "rows: -3"), HasSubstr("rows x cols"));
  EXPECT_THAT(changed("rows: 3", "raws: 3"), HasSubstr("not a finite number"));
  EXPECT_THAT(changed("image_width: 640", "image_width: 6.5"), HasSubstr("the width 6.5"));
  EXPECT_THAT(changed("image_width: 640", "image_width: 2000000000"), HasSubstr("the width"));
  EXPECT_THAT(changed("image_width: 640", "fisheye_model: 1"), HasSubstr("four numbers"));
  EXPECT_THAT(changed("0.25", "\"x\""), HasSubstr("reprojection"));
  EXPECT_THAT(changed("rows: 5\n   cols: 1\n   dt: d\n   data: [ 0.1, 0.2, 0.3, 0.4, 0.5 ]",
                      "rows: 9\n   cols: 1\n   dt: d\n   data: [ 0, 0, 0, 0, 0, 0, 0, 0, 1 ]"),
              HasSubstr("more than the eight"));
  EXPECT_THAT(changed("[ 500.", "[ [ 500."), HasSubstr("'[' is not closed"));
  EXPECT_THAT(changed("image_width: 640", "image_height: 640"),
              HasSubstr("a second 'image_height'"));
  EXPECT_THAT(refusal("%YAML:1.0\n---\n"), HasSubstr("has none of"));
  EXPECT_THAT(refusal("%YAML:1.0\n---\n- 1\n- 2\n"), HasSubstr("line 3"));
  EXPECT_THAT(refusal("%YAML:1.0\n  a: 1\n"), HasSubstr("line 2"));
  EXPECT_THAT(refusal("%YAML:1.0\n---\nK: !!binary \"$base64$AAAA\"\n"), HasSubstr("not a finite"));

  const std::string xml = "<?xml version=\"1.0\"?>\n<opencv_storage>\n";
  const std::string matrix = "<K a='>'>5 0 3\n0 6 4 0 0 1</K>";
  EXPECT_EQ(refusal(xml + "<!-- <K> -->" + matrix + "<flags/></opencv_storage>"), "accepted");
  EXPECT_THAT(refusal("<?xml version=\"1.0\"?>\n<html></html>\n"), HasSubstr("not of OpenCV"));
  EXPECT_THAT(refusal(xml + matrix), HasSubstr("<opencv_storage> is not closed"));
  EXPECT_THAT(refusal(xml + matrix + matrix), HasSubstr("a second <K>"));
  EXPECT_THAT(refusal(xml + "</K>"), HasSubstr("</K> closes nothing"));
  EXPECT_THAT(refusal(xml + "<!DOCTYPE x>"), HasSubstr("not a tag of OpenCV"));
  EXPECT_THAT(refusal(xml + "<>"), HasSubstr("not a tag of OpenCV"));
  EXPECT_THAT(refusal(xml + "<!-- "), HasSubstr("cut short"));
  EXPECT_THAT(refusal(xml + "<K a='>"), HasSubstr("cut short"));
  EXPECT_THAT(refusal("<?xml"), HasSubstr("cut short"));
}

// cv::FileStorage would end the program for some of these files.
TEST_F(CameraFileTest, NestedAndTruncatedOpenCvFilesAreRefused) {
  const auto repeated = [](const std::string& text, int times) {
    std::string result;
    for (int k = 0; k < times; ++k) result += text;
    return result;
  };
  const std::string yaml = "%YAML:1.0\n---\na: ";
  const std::string xml = "<?xml version=\"1.0\"?>\n<opencv_storage>\n";
  for (const std::string& text :
       {yaml + repeated("[", 900'000), yaml + repeated("[\n", 400'000),
        yaml + repeated("{a: ", 200'000), yaml + "\n" + repeated("- ", 400'000),
        yaml + repeated("a: ", 300'000), xml + repeated("<a>", 300'000),
        xml + repeated("<a/>", 200'000), xml + "<a>" + repeated("<_>", 300'000)}) {
    EXPECT_NE(refusal(text), "accepted") << text.substr(0, 60);
  }
  for (std::size_t size = 0; size < kOpenCvFile.find("1. ]"); size += 3)
    EXPECT_NE(refusal(kOpenCvFile.substr(0, size)), "accepted") << size;
}

TEST_F(CameraFileTest, ColmapCamerasAreShiftedByHalfAPixel) {
  const Camera simple = read("# Camera list\n\n1 SIMPLE_PINHOLE 640 480 500 320 240\n");
  EXPECT_EQ(simple.width, 640);
  EXPECT_EQ(simple.fx, 500);
  EXPECT_EQ(simple.fy, 500);
  EXPECT_EQ(simple.cx, 319.5);
  EXPECT_EQ(simple.cy, 239.5);
  EXPECT_EQ(read("1 PINHOLE 640 480 500 510 320 240").fy, 510);
  EXPECT_EQ(read("1 SIMPLE_RADIAL 640 480 500 320 240 0.1\n").distortion,
            (std::array<double, 8>{0.1, 0, 0, 0, 0}));
  EXPECT_EQ(read("1 RADIAL 640 480 500 320 240 0.1 0.2\r\n").distortion,
            (std::array<double, 8>{0.1, 0.2, 0, 0, 0}));
  EXPECT_EQ(read("1 OPENCV 640 480 500 510 320 240 0.1 0.2 0.3 0.4\n").distortion,
            (std::array<double, 8>{0.1, 0.2, 0.3, 0.4, 0}));
  EXPECT_EQ(read("1 FULL_OPENCV 640 480 500 510 320 240 1 2 3 4 5 0 0 0\n").distortion,
            (std::array<double, 8>{1, 2, 3, 4, 5}));
  const Camera full = read("1 FULL_OPENCV 640 480 500 510 320 240 1 2 3 4 5 6 7 8\n");
  EXPECT_EQ(full.lens, Lens::kRational);
  EXPECT_EQ(full.distortion, (std::array<double, 8>{1, 2, 3, 4, 5, 6, 7, 8}));
  const Camera fish = read("1 OPENCV_FISHEYE 640 480 500 510 320 240 1 2 3 4\n");
  EXPECT_EQ(fish.lens, Lens::kFisheye);
  EXPECT_EQ(fish.distortion, (std::array<double, 8>{1, 2, 3, 4}));
  EXPECT_EQ(read("1 RADIAL_FISHEYE 640 480 500 320 240 .1 .2\n").lens, Lens::kFisheye);
  EXPECT_THAT(refusal("#\n1 FOV 640 480 500 500 320 240 1\n"), HasSubstr("line 2: camera model"));
  EXPECT_THAT(refusal("1 PINHOLE 640 480 500 510 320\n"), HasSubstr("line 1"));
  EXPECT_THAT(refusal("1 PINHOLE 640 480 500 510 320 240 1\n"), HasSubstr("4 parameters"));
  EXPECT_THAT(refusal("1 PINHOLE 640 480 inf 510 320 240\n"), HasSubstr("'inf'"));
  EXPECT_THAT(refusal("1 PINHOLE 640 480 -5 510 320 240\n"), HasSubstr("not positive"));
  EXPECT_THAT(refusal("1 PINHOLE 640 480 5 5 3 2\n2 PINHOLE 640 480 5 5 3 2\n"),
              HasSubstr("line 2: one camera"));
}

TEST_F(CameraFileTest, AMatrixIsNineNumbers) {
  // The form of the strecha benchmark.
  const Camera camera = read("2759.48 0.0 1520.69 \n0.0 2764.16 1006.81 \n0.0 0.0 1.0 \n");
  EXPECT_EQ(camera.fx, 2759.48);
  EXPECT_EQ(camera.fy, 2764.16);
  EXPECT_EQ(camera.cx, 1520.69);
  EXPECT_EQ(camera.cy, 1006.81);
  EXPECT_EQ(camera.width, 0);
  EXPECT_THAT(refusal("500 0 320 0 500 240 0 0\n"), HasSubstr("9 numbers, not 8"));
  EXPECT_THAT(refusal("500 0 320 0 500 240 0 0 1 1\n"), HasSubstr("line 1"));
  EXPECT_THAT(refusal("500 0 320\n0 nan 240\n0 0 1\n"), HasSubstr("line 2: 'nan'"));
  EXPECT_THAT(refusal("500 9 320\n0 500 240\n0 0 1\n"), HasSubstr("skew"));
  EXPECT_THAT(refusal("500 0 320\n1 500 240\n0 0 1\n"), HasSubstr("not a calibration matrix"));
  EXPECT_THAT(refusal("0 0 320\n0 500 240\n0 0 1\n"), HasSubstr("not positive"));
}

TEST_F(CameraFileTest, OtherFilesAreRefused) {
  EXPECT_THAT(refusal(""), HasSubstr("is empty"));
  EXPECT_THAT(refusal("# nothing\n\n"), HasSubstr("is empty"));
  EXPECT_THAT(refusal("hello\n"), HasSubstr("is not a camera"));
  EXPECT_THAT(refusal("{\"K\": [1]}\n"), HasSubstr("is not a camera"));
  EXPECT_THAT(refusal("\xFF\xD8\xFF\xE0 JFIF"), HasSubstr("is not a camera"));
  EXPECT_THAT(refusal(kTarsierFile + std::string(1, '\0')), HasSubstr("is not a text file"));
  EXPECT_THAT(refusal(std::string(1'000'001, ' ')), HasSubstr("larger than"));
  EXPECT_THROW((void)read_camera_file(path("missing")), InputError);
  EXPECT_THROW((void)read_camera_file(folder_), InputError);
}

// All three lens models through all three file formats.
TEST_F(CameraFileTest, EveryLensRoundTripsInEveryFormat) {
  const std::vector<Camera> cameras{
      {640, 480, 500.1, 501.2, 320.3, 240.4, {-0.1, 0.2, 1e-3, -2e-3, 0.01}, 0.25},
      {640,
       480,
       500.1,
       501.2,
       320.3,
       240.4,
       {-0.1, 0.2, 1e-3, -2e-3, 0.01, 0.3, -0.2, 0.1},
       0.25,
       Lens::kRational},
      {640, 480, 300, 301, 320, 240, {0.1, -0.02, 1e-3, 0}, 0.5, Lens::kFisheye}};
  for (const CameraFormat format :
       {CameraFormat::kTarsier, CameraFormat::kOpencv, CameraFormat::kColmap}) {
    for (const Camera& camera : cameras) {
      write_camera_file(path("camera.txt"), camera, format);
      const Camera back = read_camera_file(path("camera.txt"));
      EXPECT_EQ(back.lens, camera.lens);
      EXPECT_EQ(back.distortion, camera.distortion);
      EXPECT_EQ(back.width, 640);
      EXPECT_EQ(back.fy, camera.fy);
      EXPECT_NEAR(back.cx, camera.cx, 1e-12);
      EXPECT_NEAR(back.cy, camera.cy, 1e-12);
      EXPECT_EQ(back.rms, format == CameraFormat::kColmap ? 0 : camera.rms);
      if (format != CameraFormat::kOpencv) continue;
      cv::FileStorage storage(path("camera.txt"), cv::FileStorage::READ);
      cv::Mat matrix;
      cv::Mat k;
      storage["camera_matrix"] >> matrix;
      storage["distortion_coefficients"] >> k;
      ASSERT_EQ(matrix.type(), CV_64F);
      EXPECT_EQ(matrix.at<double>(0, 2), camera.cx);
      ASSERT_EQ(k.total(), camera.coefficients().size());
      EXPECT_EQ(k.at<double>(3), camera.distortion[3]);
    }
  }
  Camera unknown_size = cameras[0];
  unknown_size.width = unknown_size.height = 0;
  EXPECT_THROW(write_camera_file(path("camera.txt"), unknown_size, CameraFormat::kColmap),
               std::invalid_argument);
  Camera wrong = cameras[2];
  wrong.distortion[6] = 1;
  EXPECT_THROW(write_camera_file(path("camera.txt"), wrong), std::invalid_argument);
}

TEST_F(CameraFileTest, OpenCvFisheyesAreMarkedByTheFileOrTheOptions) {
  const std::string four = replaced(replaced(kOpenCvFile, "rows: 5", "rows: 4"), ", 0.5 ]", " ]");
  EXPECT_EQ(read(four).lens, Lens::kPinhole);
  EXPECT_EQ(read(replaced(four, "image_width", "fisheye_model: 1\nimage_width")).lens,
            Lens::kFisheye);
  EXPECT_EQ(read(replaced(four, "image_width", "fisheye_model: 0\nimage_width")).lens,
            Lens::kPinhole);
  EXPECT_EQ(read(replaced(four, "image_width", "distortion_model: equidistant\nimage_width")).lens,
            Lens::kFisheye);
  (void)read(four);
  EXPECT_EQ(read_camera_file(path("camera.txt"), {true}).lens, Lens::kFisheye);
}

TEST(ParseCameraTest, TakesFourEightOrNineNumbers) {
  const Camera four = parse_camera("500,501, 320 ,2.4e2");
  EXPECT_EQ(four.fx, 500);
  EXPECT_EQ(four.fy, 501);
  EXPECT_EQ(four.cx, 320);
  EXPECT_EQ(four.cy, 240);
  EXPECT_EQ(four.width, 0);
  EXPECT_FALSE(four.is_distorted());
  EXPECT_EQ(parse_camera("1,1,0,0,.1,-.2,.3,.4").distortion,
            (std::array<double, 8>{.1, -.2, .3, .4, 0}));
  EXPECT_EQ(parse_camera("1,1,0,0,1,2,3,4,5").distortion, (std::array<double, 8>{1, 2, 3, 4, 5}));
  EXPECT_EQ(parse_camera("1,1,0,0,1,2,3,4,5,6,7,8").lens, Lens::kRational);
  for (const char* text :
       {"", ",", "500", "500,500,320", "500,500,320,240,0", "1,1,1,1,1,1,1,1,1,1",
        "1,1,1,1,1,1,1,1,1,1,1,1,1", "500,500,320,", "500,500,320,x", "500,500,320,nan",
        "inf,500,320,240", "0,500,320,240", "500,-1,320,240", "500 500 320 240", "500,500,320,240x",
        "1e999,1,1,1"}) {
    EXPECT_THROW((void)parse_camera(text), UsageError) << text;
  }
}

}  // namespace
}  // namespace tarsier::geometry
