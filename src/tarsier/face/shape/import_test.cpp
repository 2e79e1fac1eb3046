// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/import.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cmath>
#include <cstdlib>
#include <filesystem>

namespace tarsier::face::shape {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const char* const kPts = "version: 1\nn_points: 3\n{\n1.5 2\n3 4\r\n5e0 -6.25\n}\n";
const char* const kAsf =
    "# AAM Shape File\n\n3\n# points\n"
    "0 \t0 \t0.25 \t0.5 \t0 \t0 \t1\t0.0\t0.0\n"
    "0 0 0.5 0.25 1 0 2 0 0\n"
    "0 0 0.75 1.0 2 1 2 0 0\n"
    "\n# host\nhost.png\n";

class Import : public FolderTest {
 protected:
  void write(const std::string& name, const std::string& text) const {
    fs::create_directories(fs::path(path(name)).parent_path());
    write_file_atomically(path(name), text);
  }
  void add_test_image(const std::string& name, cv::Size size = {8, 6}) const {
    fs::create_directories(fs::path(path(name)).parent_path());
    write_image(path(name), cv::Mat(size, CV_8UC3, cv::Scalar(1, 2, 3)));
  }
  template <typename Call>
  [[nodiscard]] std::string refusal(const Call& call) const {
    try {
      call();
    } catch (const InputError& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      return error.what();
    }
    return "accepted";
  }
};

TEST_F(Import, ReadsPts) {
  write("a.pts", kPts);
  const Eigen::Matrix2Xd points = read_pts(path("a.pts"), 0);
  ASSERT_EQ(points.cols(), 3);
  EXPECT_EQ(points(0, 0), 1.5);
  EXPECT_EQ(points(1, 2), -6.25);
  EXPECT_EQ(read_pts(path("a.pts"), 1)(1, 1), 3);
}

TEST_F(Import, RefusesBadPts) {
  const auto refused = [&](const std::string& text) {
    write("bad.pts", text);
    const std::string what = refusal([&] { (void)read_pts(path("bad.pts"), 0); });
    EXPECT_THAT(what, HasSubstr("bad.pts"));
    return what;
  };
  EXPECT_THAT(refused(""), HasSubstr("{"));
  EXPECT_THAT(refused("n_points: 2\n{\n1 2\n}\n"), HasSubstr("2 announced"));
  EXPECT_THAT(refused("{\n1 2\n"), HasSubstr("early"));
  EXPECT_THAT(refused("{\n}\n"), HasSubstr("no points"));
  EXPECT_THAT(refused("{\n1 2\n3 x\n}\n"), HasSubstr("line 3"));
  EXPECT_THAT(refused("{\n1 2 3\n}\n"), HasSubstr("line 2"));
  EXPECT_THAT(refused("{\n1 nan\n}\n"), HasSubstr("line 2"));
  EXPECT_THAT(refused("{\n1 1e300\n}\n"), HasSubstr("line 2"));
  EXPECT_THAT(refused("n_points: 99999999\n{\n1 2\n}\n"), HasSubstr("line 1"));
}

TEST_F(Import, ReadsAsf) {
  write("a.asf", kAsf);
  const AsfShape shape = read_asf(path("a.asf"));
  ASSERT_EQ(shape.relative.cols(), 3);
  EXPECT_EQ(shape.relative(0, 2), 0.75);
  EXPECT_THAT(shape.connections, ElementsAre(std::array<int, 2>{0, 1}, std::array<int, 2>{1, 2}));
  EXPECT_EQ(shape.image, "host.png");
}

TEST_F(Import, RefusesBadAsf) {
  const auto refused = [&](const std::string& text) {
    write("bad.asf", text);
    return refusal([&] { (void)read_asf(path("bad.asf")); });
  };
  const std::string row = "0 0 0.5 0.5 0 0 0\n";
  EXPECT_THAT(refused(""), HasSubstr("early"));
  EXPECT_THAT(refused("2\n" + row), HasSubstr("early"));
  EXPECT_THAT(refused("2\n" + row + row + "a.png\n"), HasSubstr("twice"));
  EXPECT_THAT(refused("1\n0 0 0.5 0.5 0 0 1\na.png\n"), HasSubstr("line 2"));
  EXPECT_THAT(refused("1\n0 0 0.5 500 0 0 0\na.png\n"), HasSubstr("line 2"));
  EXPECT_THAT(refused("1\n0 0 0.5 0.5 0\na.png\n"), HasSubstr("line 2"));
  EXPECT_THAT(refused("-1\n"), HasSubstr("line 1"));
  EXPECT_EQ(refused("1\n" + row + "a.png\n"), "accepted");
}

TEST_F(Import, FolderImportsSamplesWithImages) {
  write("set/b.pts", kPts);
  add_test_image("set/b.png");
  write("set/a.pts", kPts);
  add_test_image("set/a.pgm");
  write("set/lonely.pts", kPts);
  write("set/broken.pts", "{\n1\n}\n");
  add_test_image("set/broken.png");
  write("set/four.pts", "{\n1 2\n3 4\n5 6\n7 8\n}\n");
  add_test_image("set/four.png");
  const Imported imported = import_landmarks(path("set"));
  ASSERT_EQ(imported.set.samples.size(), 2U);
  EXPECT_EQ(imported.set.samples[0].image, path("set/a.pgm"));
  EXPECT_EQ(imported.set.samples[1].image, path("set/b.png"));
  EXPECT_THAT(imported.skipped,
              ElementsAre(HasSubstr("broken.pts: line 2"), HasSubstr("four.pts: 4 points"),
                          HasSubstr("lonely.pts: no image")));
  fs::remove(path("set/a.pgm"));
  fs::remove(path("set/b.png"));
  fs::remove(path("set/four.png"));
  EXPECT_THAT(refusal([&] { (void)import_landmarks(path("set")); }), HasSubstr("nothing left"));
  fs::create_directories(path("empty"));
  EXPECT_THAT(refusal([&] { (void)import_landmarks(path("empty")); }), HasSubstr("no annotation"));
  EXPECT_THAT(refusal([&] { (void)import_landmarks(path("none.pts")); }), HasSubstr("none.pts"));
  EXPECT_THAT(refusal([&] { (void)import_landmarks(path("set/b.xyz")); }), HasSubstr("b.xyz"));
}

TEST_F(Import, ListKeepsOrderAndPaths) {
  write("set/b.pts", kPts);
  add_test_image("set/b.png");
  write("set/a b.pts", kPts);
  add_test_image("set/a b.png");
  write("set/list.txt",
        "\xEF\xBB\xBF"
        "b.png\r\n\n# left out: x.png\na b.png\nnone.png\n");
  ImportOptions options;
  options.pts_offset = 1;
  const Imported imported = import_landmarks(path("set/list.txt"), options);
  ASSERT_EQ(imported.set.samples.size(), 2U);
  EXPECT_EQ(imported.set.samples[0].image, path("set/b.png"));
  EXPECT_EQ(imported.set.samples[1].image, path("set/a b.png"));
  EXPECT_EQ(imported.set.samples[1].points(0, 0), 0.5);
  EXPECT_THAT(imported.skipped, ElementsAre(HasSubstr("none.png")));
}

TEST_F(Import, AsfScalesWithTheImage) {
  write("07-3m.asf", kAsf);
  add_test_image("07-3m.png", {80, 40});
  Imported imported = import_landmarks(path("07-3m.asf"));
  ASSERT_EQ(imported.set.samples.size(), 1U);
  EXPECT_EQ(imported.set.samples[0].points(0, 0), 20);
  EXPECT_EQ(imported.set.samples[0].points(1, 2), 40);
  EXPECT_EQ(imported.set.samples[0].person, "07");
  EXPECT_EQ(imported.set.connections.size(), 2U);
  // The host named in the file is used instead, but only in the same folder.
  fs::remove(path("07-3m.png"));
  add_test_image("host.png", {8, 8});
  imported = import_landmarks(path("07-3m.asf"));
  EXPECT_EQ(imported.set.samples[0].image, path("host.png"));
  std::string elsewhere = kAsf;
  elsewhere.replace(elsewhere.find("host.png"), 8, "../x/host.png");
  write("set/a.asf", elsewhere);
  add_test_image("x/host.png");
  EXPECT_THAT(refusal([&] { (void)import_landmarks(path("set/a.asf")); }), HasSubstr("no image"));
}

TEST_F(Import, BoxesAroundLandmarks) {
  LandmarkSet set;
  const auto add = [&](const char* image, double x, bool is_complete) {
    LandmarkSample sample;
    sample.image = image;
    sample.points.resize(2, 4);
    sample.points << x - 10, x + 10, x - 10, x + 10, 90, 90, 110, 110;
    if (!is_complete) sample.points.col(0).setConstant(std::nan(""));
    set.samples.push_back(sample);
  };
  add("two.png", 50, true);
  add("two.png", 150, true);
  add("boxed.png", 50, true);
  add("boxed.png", 150, false);
  set.samples.back().box = cv::Rect2d(130, 80, 40, 40);
  add("unclear.png", 50, true);
  add("unclear.png", 150, false);
  const std::vector<BoxedImage> images = boxes_from_landmarks(set, 2);
  ASSERT_EQ(images.size(), 2U) << "where a face may be anywhere nothing can be learned";
  ASSERT_EQ(images[0].boxes.size(), 2U);
  // Root mean squared distance sqrt(200), two of them, around (50, 100).
  const cv::Rect2d& box = images[0].boxes[0];
  EXPECT_NEAR(box.width, 2 * std::sqrt(200), 1e-9);
  EXPECT_NEAR(box.x + box.width / 2, 50.5, 1e-9);
  EXPECT_NEAR(box.y + box.height / 2, 100.5, 1e-9);
  EXPECT_EQ(images[0].shapes[1](0, 0), 140);
  EXPECT_EQ(images[1].boxes.size(), 1U);
  EXPECT_THAT(images[1].ignored, ElementsAre(cv::Rect2d(130, 80, 40, 40)));
}

TEST_F(Import, AFaceWithoutPointsHasNoBox) {
  LandmarkSet set;
  set.samples.resize(2);
  set.samples[0].image = "unclear.png";
  set.samples[1].image = "boxed.png";
  set.samples[1].box = cv::Rect2d(130, 80, 40, 40);
  const std::vector<BoxedImage> images = boxes_from_landmarks(set, 2);
  ASSERT_EQ(images.size(), 1U);
  EXPECT_THAT(images[0].boxes, ElementsAre());
  EXPECT_THAT(images[0].ignored, ElementsAre(cv::Rect2d(130, 80, 40, 40)));
}

TEST_F(Import, MuctTable) {
  write("muct.csv",
        "name,tag,x00,y00,x01,y01\ni000qa-fn,0000,201,348,0,0\ni001qb-mn,0000,1.5,2,3,4\n"
        "i002qb-mn,0000,1,2,3,4\n");
  add_test_image("i000qa-fn.jpg");
  add_test_image("images/i001qb-mn.jpg");
  ImportOptions options;
  options.images = path("images");
  const Imported imported = import_landmarks(path("muct.csv"), options);
  ASSERT_EQ(imported.set.samples.size(), 2U);
  EXPECT_EQ(imported.set.samples[0].person, "i000");
  EXPECT_EQ(imported.set.samples[0].points(1, 0), 348);
  EXPECT_TRUE(imported.set.samples[0].is_missing(1));
  EXPECT_EQ(imported.set.samples[1].image, path("images/i001qb-mn.jpg"));
  EXPECT_THAT(imported.skipped, ElementsAre(HasSubstr("i002qb-mn")));

  const auto refused = [&](const std::string& rows) {
    write("bad.csv", rows);
    return refusal([&] { (void)import_landmarks(path("bad.csv")); });
  };
  const std::string header = "name,tag,x00,y00\n";
  EXPECT_THAT(refused("i000,0,1,2\n"), HasSubstr("header"));
  EXPECT_THAT(refused(header + "../../etc/x,0,1,2\n"), HasSubstr("line 2"));
  EXPECT_THAT(refused(header + "a,0,1\n"), HasSubstr("pairs"));
  EXPECT_THAT(refused(header + "a,0,1,b\n"), HasSubstr("line 2"));
  EXPECT_THAT(refused(header + "a,0,-10,20\n"), HasSubstr("Stasm"));
  EXPECT_THAT(refused(header + "i000qa-fn,0,1,2\ni000qa-fn,0,1,2,3,4\n"), HasSubstr("line 3"));
}

TEST_F(Import, DlibXml) {
  add_test_image("a & b.png");
  const std::string head = "<?xml version='1.0'?>\n<!-- <image> -->\n<dataset><images>\n";
  const std::string image = "<image file='a &amp; b.png'>";
  const std::string box = "<box top='90' left=\"194\" width='37' height='38'>";
  write("a.xml", head + image + box +
                     "<label>face</label><part name='00' x='201' y='107'/>\n"
                     "<part name='2' x='-3.5' y='1'/></box>\n" +
                     box + "</box><box top='1' left='1' width='5' height='5'/>" +
                     "<box top='1' left='1' width='5' height='5' ignore='1'>"
                     "<part name='0' x='1' y='1'/></box></image>"
                     "<image file='gone.png'>" +
                     box + "<part name='0' x='1' y='1'/></box></image></images></dataset>\n");
  const Imported imported = import_landmarks(path("a.xml"));
  ASSERT_EQ(imported.set.samples.size(), 1U);
  const LandmarkSample& sample = imported.set.samples[0];
  EXPECT_EQ(sample.image, path("a & b.png"));
  EXPECT_EQ(sample.box, cv::Rect2d(194, 90, 37, 38));
  ASSERT_EQ(sample.points.cols(), 3);
  EXPECT_EQ(sample.points(0, 0), 201);
  EXPECT_TRUE(sample.is_missing(1));
  EXPECT_EQ(sample.points(0, 2), -3.5);
  EXPECT_THAT(imported.skipped, ElementsAre(HasSubstr("gone.png")));

  const BoxedImages boxed = read_dlib_boxes(path("a.xml"));
  ASSERT_EQ(boxed.images.size(), 1U);
  const BoxedImage& image_with_boxes = boxed.images[0];
  EXPECT_THAT(image_with_boxes.boxes,
              ElementsAre(cv::Rect2d(194, 90, 37, 38), cv::Rect2d(194, 90, 37, 38),
                          cv::Rect2d(1, 1, 5, 5)));
  EXPECT_THAT(image_with_boxes.ignored, ElementsAre(cv::Rect2d(1, 1, 5, 5)));
  ASSERT_EQ(image_with_boxes.shapes.size(), 3U);
  EXPECT_EQ(image_with_boxes.shapes[0](0, 2), -3.5);
  EXPECT_EQ(image_with_boxes.shapes[2].cols(), 0);
  EXPECT_THAT(boxed.skipped, ElementsAre(HasSubstr("gone.png")));
  EXPECT_THAT(refusal([&] {
                write("empty.xml", "<dataset></dataset>");
                (void)read_dlib_boxes(path("empty.xml"));
              }),
              HasSubstr("names no images"));
  // One part of each box is the last of 10 000 points: 32 bytes of text, 160 kB of memory.
  const auto large = [&](const auto& read) {
    return refusal([&] {
      std::string many = "<images><image file='a &amp; b.png'>";
      for (int i = 0; i < 2001; ++i)
        many += "<box top='1' left='1' width='5' height='5'><part name='9999' x='1' y='1'/></box>";
      write("many.xml", many + "</image></images>");
      read();
    });
  };
  EXPECT_THAT(large([&] { (void)read_dlib_boxes(path("many.xml")); }),
              HasSubstr("20000000 points"));
  EXPECT_THAT(large([&] { (void)import_landmarks(path("many.xml")); }),
              HasSubstr("2001 boxes of 10000 points"));

  const auto refused = [&](const std::string& text) {
    write("bad.xml", text);
    return refusal([&] { (void)import_landmarks(path("bad.xml")); });
  };
  EXPECT_THAT(refused(""), HasSubstr("no annotation"));
  EXPECT_THAT(refused("<!DOCTYPE x [<!ENTITY a 'b'>]>"), HasSubstr("declarations"));
  EXPECT_THAT(refused(head + "<image file='&a;'/>"), HasSubstr("line 4"));
  EXPECT_THAT(refused(head + "<image file='a"), HasSubstr("early"));
  EXPECT_THAT(refused(head + "<image file=a>"), HasSubstr("quotes"));
  EXPECT_THAT(refused(head + "<image>"), HasSubstr("file"));
  EXPECT_THAT(refused(box), HasSubstr("without an image"));
  EXPECT_THAT(refused(image + box), HasSubstr("early"));
  EXPECT_THAT(refused(image + box + box), HasSubstr("box in a box"));
  EXPECT_THAT(refused(image + "<part name='0' x='1' y='1'/>"), HasSubstr("without a box"));
  EXPECT_THAT(refused(image + "<box top='0' left='0' width='0' height='1'>"), HasSubstr("area"));
  for (const char* part : {"name='x' x='1' y='1'", "name='-1' x='1' y='1'",
                           "name='1000000' x='1' y='1'", "name='0' x='1'", "name='0' x='1' y='inf'",
                           "name='0' x='1' y='1'/><part name='00' x='1' y='1'"}) {
    EXPECT_THAT(refused(image + box + "<part " + part + "/></box></image>"), HasSubstr("line 1"))
        << part;
  }
  EXPECT_THAT(refused("<image " + std::string(200, '<')), HasSubstr("no XML"));
}

// The development set.
class ImportData : public ::testing::Test {
 protected:
  static std::string folder(const std::string& name) {
    const char* data = std::getenv("TARSIER_DATA");
    return (fs::path(data == nullptr ? "" : data) / name).string();
  }
};

TEST_F(ImportData, Faces68) {
  if (!fs::exists(folder("faces68/frontal.txt"))) GTEST_SKIP() << "no faces68 in $TARSIER_DATA";
  const Imported frontal = import_landmarks(folder("faces68/frontal.txt"));
  EXPECT_EQ(frontal.set.samples.size(), 694U);
  EXPECT_TRUE(frontal.skipped.empty());
  EXPECT_EQ(import_landmarks(folder("faces68")).set.samples.size(), 1000U);
  // The symmetry is that of faces: mirrored faces are as near to the mean as the others.
  ShapeModelOptions options;
  options.mirror = true;
  const ShapeModel mirrored = train_shape_model(frontal.set, options);
  const ShapeModel plain = train_shape_model(frontal.set);
  EXPECT_LT(mirrored.deviation[0], 1.1 * plain.deviation[0]);
}

TEST_F(ImportData, ImmFrontal) {
  if (!fs::exists(folder("imm-frontal/01_01.asf")))
    GTEST_SKIP() << "no imm-frontal in $TARSIER_DATA";
  const Imported imm = import_landmarks(folder("imm-frontal"));
  EXPECT_EQ(imm.set.samples.size(), 60U);
  EXPECT_TRUE(imm.skipped.empty());
  EXPECT_EQ(imm.set.points(), 73);
  EXPECT_EQ(imm.set.samples[0].person, "01");
  // The connections in the files are those of known_markup.
  auto known = known_markup(73)->connections;
  for (auto& [a, b] : known)
    if (a > b) std::swap(a, b);
  EXPECT_THAT(imm.set.connections, ::testing::UnorderedElementsAreArray(known));
  // On average each mirrored point is near its partner, nearer than neighbouring points are.
  Eigen::Matrix2Xd sum = Eigen::Matrix2Xd::Zero(2, 73);
  for (const LandmarkSample& sample : imm.set.samples) {
    const Eigen::Matrix2Xd mirror = mirrored(sample, imm.set.mirror, 800).points;
    const double size = std::sqrt(
        (sample.points.colwise() - sample.points.rowwise().mean().eval()).squaredNorm() / 73);
    sum += (fit_similarity(mirror, sample.points)(mirror) - sample.points) / size;
  }
  EXPECT_LT((sum / 60).colwise().norm().maxCoeff(), 0.06);
}

TEST_F(ImportData, DlibFaces) {
  if (!fs::exists(folder("dlib-faces"))) GTEST_SKIP() << "no dlib-faces in $TARSIER_DATA";
  const Imported faces = import_landmarks(folder("dlib-faces"));
  EXPECT_EQ(faces.set.samples.size(), 18U);
  for (const LandmarkSample& sample : faces.set.samples) {
    EXPECT_TRUE(sample.is_complete());
    EXPECT_TRUE(sample.box.has_value());
  }
}

}  // namespace
}  // namespace tarsier::face::shape
