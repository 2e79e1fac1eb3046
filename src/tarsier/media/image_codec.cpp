// SPDX-License-Identifier: MIT
#include "tarsier/media/image_codec.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <jpeglib.h>
// must follow jpeglib.h
#include <jerror.h>
#include <memory>
#include <new>
#include <png.h>
#include <zlib.h>

// Both libraries report errors by longjmp. Functions that it may skip must have no local variable
// with a destructor; their callers own such objects.
namespace tarsier {
namespace {

using Bytes = std::span<const std::uint8_t>;

// --- JPEG ---

#ifdef JCS_EXTENSIONS  // libjpeg-turbo supports BGR in memory

struct JpegErrors {
  jpeg_error_mgr manager{};
  std::jmp_buf jump{};
  bool warned = false;
};

[[noreturn]] void leave(j_common_ptr codec) {
  std::longjmp(reinterpret_cast<JpegErrors*>(codec->err)->jump, 1);
}

// Spare bytes before a marker, which many cameras write, change no pixel.
void note(j_common_ptr codec, int level) {
  if (level < 0 && codec->err->msg_code != JWRN_EXTRANEOUS_DATA)
    reinterpret_cast<JpegErrors*>(codec->err)->warned = true;
}

void ignore_message(j_common_ptr) {}

void init(JpegErrors& errors) {
  jpeg_std_error(&errors.manager);
  errors.manager.error_exit = leave;
  errors.manager.emit_message = note;
  errors.manager.output_message = ignore_message;
}

// Whether the image may need rotation, which is left to OpenCV.
bool has_exif(const jpeg_decompress_struct& codec) {
  for (jpeg_saved_marker_ptr marker = codec.marker_list; marker != nullptr; marker = marker->next) {
    if (marker->marker == JPEG_APP0 + 1) return true;
  }
  return false;
}

// Returns false if not decoded, or decoded with a warning.
bool decode_jpeg(Bytes bytes, const ImageHeader& header, bool gray, cv::Mat& image) {
  JpegErrors errors;
  init(errors);
  jpeg_decompress_struct codec{};
  codec.err = &errors.manager;
  if (setjmp(errors.jump) != 0) {
    jpeg_destroy_decompress(&codec);
    return false;
  }
  jpeg_create_decompress(&codec);
  jpeg_mem_src(&codec, bytes.data(), static_cast<unsigned long>(bytes.size()));
  jpeg_save_markers(&codec, JPEG_APP0 + 1, 16);
  jpeg_read_header(&codec, TRUE);
  const bool is_supported = !has_exif(codec) &&
                            (codec.num_components == 1 || codec.num_components == 3) &&
                            codec.image_width == static_cast<JDIMENSION>(header.width) &&
                            codec.image_height == static_cast<JDIMENSION>(header.height);
  if (is_supported) {
    codec.out_color_space = gray ? JCS_GRAYSCALE : JCS_EXT_BGR;
    codec.out_color_components = gray ? 1 : 3;
    jpeg_start_decompress(&codec);
    while (codec.output_scanline < codec.output_height) {
      JSAMPROW row = image.ptr(static_cast<int>(codec.output_scanline));
      jpeg_read_scanlines(&codec, &row, 1);
    }
    jpeg_finish_decompress(&codec);
  }
  jpeg_destroy_decompress(&codec);
  return is_supported && !errors.warned;
}

// `buffer` is allocated with malloc; the caller frees it.
bool encode_jpeg(const cv::Mat& image, int quality, unsigned char*& buffer, unsigned long& size) {
  JpegErrors errors;
  init(errors);
  jpeg_compress_struct codec{};
  codec.err = &errors.manager;
  if (setjmp(errors.jump) != 0) {
    jpeg_destroy_compress(&codec);
    return false;
  }
  jpeg_create_compress(&codec);
  jpeg_mem_dest(&codec, &buffer, &size);
  codec.image_width = static_cast<JDIMENSION>(image.cols);
  codec.image_height = static_cast<JDIMENSION>(image.rows);
  codec.input_components = image.channels();
  codec.in_color_space = image.channels() == 1 ? JCS_GRAYSCALE : JCS_EXT_BGR;
  jpeg_set_defaults(&codec);
  jpeg_set_quality(&codec, quality, TRUE);
  jpeg_start_compress(&codec, TRUE);
  while (codec.next_scanline < codec.image_height) {
    auto* row = const_cast<JSAMPROW>(image.ptr(static_cast<int>(codec.next_scanline)));
    jpeg_write_scanlines(&codec, &row, 1);
  }
  jpeg_finish_compress(&codec);
  jpeg_destroy_compress(&codec);
  return true;
}

#else

bool decode_jpeg(Bytes, const ImageHeader&, bool, cv::Mat&) { return false; }
bool encode_jpeg(const cv::Mat&, int, unsigned char*&, unsigned long&) { return false; }

#endif

// --- PNG ---

struct PngErrors {
  std::jmp_buf jump{};
  bool warned = false;
};

[[noreturn]] void png_fail(png_structp codec, png_const_charp) {
  std::longjmp(static_cast<PngErrors*>(png_get_error_ptr(codec))->jump, 1);
}

void png_warn(png_structp codec, png_const_charp) {
  static_cast<PngErrors*>(png_get_error_ptr(codec))->warned = true;
}

void png_read_bytes(png_structp codec, png_bytep into, std::size_t count) {
  Bytes& remaining = *static_cast<Bytes*>(png_get_io_ptr(codec));
  if (remaining.size() < count) png_error(codec, "end of the bytes");
  std::copy_n(remaining.begin(), count, into);
  remaining = remaining.subspan(count);
}

bool decode_png(Bytes bytes, const ImageHeader& header, bool gray, cv::Mat& image) {
  PngErrors errors;
  png_structp codec = png_create_read_struct(PNG_LIBPNG_VER_STRING, &errors, png_fail, png_warn);
  if (codec == nullptr) return false;
  png_infop info = png_create_info_struct(codec);
  if (setjmp(errors.jump) != 0) {
    png_destroy_read_struct(&codec, &info, nullptr);
    return false;
  }
  if (info == nullptr) png_fail(codec, nullptr);
  png_set_read_fn(codec, &bytes, png_read_bytes);
  png_read_info(codec, info);
  const int color = png_get_color_type(codec, info);
  const bool is_supported =
      png_get_bit_depth(codec, info) == 8 &&
      (color == PNG_COLOR_TYPE_GRAY || color == PNG_COLOR_TYPE_RGB) &&
      png_get_interlace_type(codec, info) == PNG_INTERLACE_NONE &&
      png_get_valid(codec, info, PNG_INFO_tRNS | PNG_INFO_eXIf) == 0 &&
      png_get_image_width(codec, info) == static_cast<png_uint_32>(header.width) &&
      png_get_image_height(codec, info) == static_cast<png_uint_32>(header.height);
  if (is_supported) {
    if (gray && color == PNG_COLOR_TYPE_RGB) png_set_rgb_to_gray(codec, 1, 0.299, 0.587);
    if (!gray && color == PNG_COLOR_TYPE_GRAY) png_set_gray_to_rgb(codec);
    if (!gray) png_set_bgr(codec);
    png_read_update_info(codec, info);
    for (int y = 0; y < image.rows; ++y) png_read_row(codec, image.ptr(y), nullptr);
    png_read_end(codec, info);
  }
  // eXIf may follow the pixels.
  const bool turned = is_supported && png_get_valid(codec, info, PNG_INFO_eXIf) != 0;
  png_destroy_read_struct(&codec, &info, nullptr);
  return is_supported && !turned && !errors.warned;
}

struct Grown {
  std::vector<std::uint8_t>* bytes = nullptr;
  bool failed = false;
};

void png_write_bytes(png_structp codec, png_bytep from, std::size_t count) {
  Grown& grown = *static_cast<Grown*>(png_get_io_ptr(codec));
  try {
    grown.bytes->insert(grown.bytes->end(), from, from + count);
  } catch (const std::bad_alloc&) {
    grown.failed = true;
  }
  if (grown.failed) png_error(codec, "not enough memory");
}

void png_flush_nothing(png_structp) {}

// Prefers speed to size, like OpenCV: prediction from the left neighbour, run lengths, the fastest
// level.
bool encode_png(const cv::Mat& image, Grown& grown) {
  PngErrors errors;
  png_structp codec = png_create_write_struct(PNG_LIBPNG_VER_STRING, &errors, png_fail, png_warn);
  if (codec == nullptr) return false;
  png_infop info = png_create_info_struct(codec);
  if (setjmp(errors.jump) != 0) {
    png_destroy_write_struct(&codec, &info);
    return false;
  }
  if (info == nullptr) png_fail(codec, nullptr);
  png_set_write_fn(codec, &grown, png_write_bytes, png_flush_nothing);
  png_set_filter(codec, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
  png_set_compression_level(codec, Z_BEST_SPEED);
  png_set_compression_strategy(codec, Z_RLE);
  png_set_IHDR(codec, info, static_cast<png_uint_32>(image.cols),
               static_cast<png_uint_32>(image.rows), 8,
               image.channels() == 1 ? PNG_COLOR_TYPE_GRAY : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(codec, info);
  png_set_bgr(codec);
  for (int y = 0; y < image.rows; ++y) png_write_row(codec, image.ptr(y));
  png_write_end(codec, info);
  png_destroy_write_struct(&codec, &info);
  return true;
}

}  // namespace

cv::Mat decode_plain(Bytes bytes, const ImageHeader& header, bool gray) {
  if (header.format != ImageFormat::kJpeg && header.format != ImageFormat::kPng) return {};
  cv::Mat image(header.height, header.width, gray ? CV_8UC1 : CV_8UC3);
  const bool decoded = header.format == ImageFormat::kJpeg ? decode_jpeg(bytes, header, gray, image)
                                                           : decode_png(bytes, header, gray, image);
  return decoded ? image : cv::Mat();
}

std::vector<std::uint8_t> encode_plain(std::string_view extension, const cv::Mat& image,
                                       int jpeg_quality) {
  std::vector<std::uint8_t> bytes;
  if (image.depth() != CV_8U || (image.channels() != 1 && image.channels() != 3)) return bytes;
  if (extension == ".png") {
    Grown grown{&bytes};
    if (!encode_png(image, grown)) bytes.clear();
    if (grown.failed) throw std::bad_alloc();
  } else if (extension == ".jpg" || extension == ".jpeg") {
    unsigned char* buffer = nullptr;
    unsigned long size = 0;
    const bool encoded = encode_jpeg(image, jpeg_quality, buffer, size);
    const std::unique_ptr<unsigned char, decltype(&std::free)> owner(buffer, &std::free);
    if (encoded) bytes.assign(buffer, buffer + size);
  }
  return bytes;
}

}  // namespace tarsier
