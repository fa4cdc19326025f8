// Writer of the smallest networks: one convolution as an ONNX file, byte by byte (onnx.proto3), so
// that what a network must give is known in closed form.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace vitreo::vision::onnx {

/// A protocol buffers message: fields of varints and of bytes.
struct Message {
  std::string bytes;
  void varint(std::uint64_t value) {
    for (; value > 127; value >>= 7) bytes += static_cast<char>(value | 128);
    bytes += static_cast<char>(value);
  }
  Message& number(unsigned field, std::uint64_t value) {
    varint(field << 3);
    varint(value);
    return *this;
  }
  Message& text(unsigned field, const std::string& value) {
    varint(field << 3 | 2);
    varint(value.size());
    bytes += value;
    return *this;
  }
};

inline std::string tensor(const std::string& name, const std::vector<std::uint64_t>& dims,
                          const std::vector<float>& values) {
  Message made;
  for (const std::uint64_t dim : dims) made.number(1, dim);
  std::string raw(4 * values.size(), '\0');
  std::memcpy(raw.data(), values.data(), raw.size());
  return made.number(2, 1).text(8, name).text(9, raw).bytes;  // 1: float
}

inline std::string value_info(const std::string& name, const std::vector<std::uint64_t>& dims) {
  Message shape;
  for (const std::uint64_t dim : dims) shape.text(1, Message().number(1, dim).bytes);
  const std::string of_tensor = Message().number(1, 1).text(2, shape.bytes).bytes;
  return Message().text(1, name).text(2, Message().text(1, of_tensor).bytes).bytes;
}

inline std::string integers(const std::string& name, const std::vector<std::uint64_t>& values) {
  Message made;
  made.text(1, name);
  for (const std::uint64_t value : values) made.number(8, value);
  return made.number(20, 7).bytes;  // 7: a list of integers
}

/// more = bias + sum over channels of weight * mean of 2 x 2 pixels, a sample a `stride` pixels.
inline std::string convolution(const std::array<float, 4>& weights, float bias,
                               std::uint64_t stride = 2) {
  std::vector<float> kernel;
  for (const float weight : weights) kernel.insert(kernel.end(), 4, weight / 4);
  const std::string node = Message()
                               .text(1, "image")
                               .text(1, "kernel")
                               .text(1, "bias")
                               .text(2, "more")
                               .text(4, "Conv")
                               .text(5, integers("kernel_shape", {2, 2}))
                               .text(5, integers("strides", {stride, stride}))
                               .bytes;
  const std::string graph = Message()
                                .text(1, node)
                                .text(2, "one")
                                .text(5, tensor("kernel", {1, 4, 2, 2}, kernel))
                                .text(5, tensor("bias", {1}, {bias}))
                                .text(11, value_info("image", {1, 4, 64, 64}))
                                .text(12, value_info("more", {1, 1, 32, 32}))
                                .bytes;
  return Message()
      .number(1, 7)
      .text(7, graph)
      .text(8, Message().text(1, "").number(2, 11).bytes)
      .bytes;
}

}  // namespace vitreo::vision::onnx
