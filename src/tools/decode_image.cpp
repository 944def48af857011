#include "autocal_vio/tools/decode_image.h"

#include <limits>
#include <opencv2/imgcodecs.hpp>

namespace autocal_vio {

cv::Mat decodeGrey(const void* bytes, std::size_t size) {
  if (size == 0 || size > static_cast<std::size_t>(std::numeric_limits<int>::max())) return {};
  // OpenCV only reads the bytes, but takes them as not const.
  const cv::Mat data(1, static_cast<int>(size), CV_8UC1, const_cast<void*>(bytes));
  try {
    return cv::imdecode(data, cv::IMREAD_GRAYSCALE);
  } catch (const cv::Exception&) {
    return {};  // damaged beyond what the decoder says by an empty result
  }
}

}  // namespace autocal_vio
