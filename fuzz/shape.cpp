// SPDX-License-Identifier: MIT
// Annotations of other programs and of Tarsier, and shape models.
#include "tarsier/face/shape/import.h"
#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/face/shape/text_files.h"
#include "tarsier/media/image_file.h"

#include <opencv2/core.hpp>

#include "fuzz.h"

namespace tarsier::fuzz {
namespace {

using namespace tarsier::face::shape;

// The images to which the annotations of the corpus refer.
void make_images() {
  static const bool made = [] {
    const cv::Mat gray(24, 32, CV_8UC3, cv::Scalar(90, 90, 90));
    for (const char* name : {"a.png", "b.png", "i000qa-fn.png", "c.png"})
      write_image(scratch_folder() + "/" + name, gray);
    file_of(std::string_view("{\n1 2\n3 4\n}\n"), "c.pts");
    return true;
  }();
  (void)made;
}

void import(Bytes input, const char* name) {
  make_images();
  const Imported imported = import_landmarks(file_of(input, name));
  imported.set.check();
  (void)boxes_from_landmarks(imported.set);
}

}  // namespace

TARSIER_FUZZ_TARGET(pts, kBytes) { import(input, "a.pts"); }
TARSIER_FUZZ_TARGET(asf, kBytes) { import(input, "b.asf"); }
TARSIER_FUZZ_TARGET(muct, kBytes) { import(input, "m.csv"); }
TARSIER_FUZZ_TARGET(annotation_list, kBytes) { import(input, "list.txt"); }

TARSIER_FUZZ_TARGET(dlib_xml, kBytes) {
  make_images();
  (void)read_dlib_boxes(file_of(input, "d.xml"));
  import(input, "d.xml");
}

TARSIER_FUZZ_TARGET(text_shapes, kBytes) {
  const std::string path = file_of(input, "shapes.txt");
  (void)is_text_shapes(path);
  const auto shapes = read_text_shapes(path);
  if (shapes.size() >= 2 && shapes.size() < 50 && shapes[0].cols() < 100) {
    try {
      (void)train_shape_model(shapes);
    } catch (const std::invalid_argument&) {  // shapes without extent
    }
  }
}

TARSIER_FUZZ_TARGET(triangles, kBytes) { (void)read_triangles(file_of(input, "mesh.txt"), 68); }

TARSIER_FUZZ_TARGET(landmark_set, kJson) {
  const std::string path = file_of(input, "set.json");
  const LandmarkSet set = read_landmark_set(path);
  set.check();
  for (const LandmarkSample& sample : set.samples) (void)image_path(path, sample);
  (void)boxes_from_landmarks(set);
  const std::string copy = scratch_folder() + "/copy.json";
  write_landmark_set(copy, set, scratch_folder());
  expect(read_landmark_set(copy).samples.size() == set.samples.size(),
         "a set changes when it is written");
}

TARSIER_FUZZ_TARGET(shape_model, kJson) {
  const ShapeModel model = read_shape_model(file_of(input, "shape.json"));
  model.check();
  const ShapeFit fit = fit_shape(model, model.mean * 30);
  (void)shape_of(model, fit);
  (void)combined_basis(model);
}

}  // namespace tarsier::fuzz
