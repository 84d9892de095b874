// MetaImage (.mha, or .mhd with its data in a file beside it), as MetaIO, ITK, PLUS and SUPRA write it: a
// text header of up to 16 MiB, then samples, packed by zlib or not, of either byte order. ITK's own reader
// (libinsighttoolkit5-dev) would bring 34 packages of 129 MB, so this one is tested against files that it
// wrote. Read: NDims 2 to 4, where the third of 4 is 1; all of MetaIO's numbers of up to 32 bits; any number
// of channels. What cannot be read faithfully (text samples, a rotated TransformMatrix, data spread over
// several files) is refused, and a size that the file does not hold is refused before anything is allocated.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "client/files/file_io.h"

namespace teletact::client {

enum class ElementType { kUint8, kInt16, kFloat32, kFloat64 };

std::size_t element_bytes(ElementType type);

template <class T>
constexpr ElementType element_type_of() {
  static_assert(std::is_same_v<T, std::uint8_t> || std::is_same_v<T, std::int16_t> ||
                std::is_same_v<T, float> || std::is_same_v<T, double>);
  if constexpr (std::is_same_v<T, std::uint8_t>) return ElementType::kUint8;
  if constexpr (std::is_same_v<T, std::int16_t>) return ElementType::kInt16;
  if constexpr (std::is_same_v<T, float>) return ElementType::kFloat32;
  return ElementType::kFloat64;
}

struct MetaImage {
  std::vector<std::size_t> size;  // 2 or 3 dimensions, the first fastest (RF: samples, lines)
  std::vector<double> spacing;    // per dimension, > 0 (metres here); empty when the file does not state it
  std::vector<double> origin;     // of the first element (Offset, Position or Origin); empty when not stated
  std::size_t channels = 1;       // interleaved: the channel is faster than every dimension
  ElementType type = ElementType::kFloat32;   // other integers are read as the least of these that holds them
  std::vector<std::byte> data;                // exactly values() * element_bytes(type)
  std::map<std::string, std::string> fields;  // the header's, as they stand: what a writer of its own added

  std::string field(const std::string& name) const;  // "" where it is not there
  std::size_t values() const;                        // elements times channels

  // The samples as T, converted value by value (double to int16 truncates: ask for what the file holds).
  template <class T>
  std::vector<T> as() const;

  // Throws std::invalid_argument when `samples` does not fill `size` times `channels`.
  template <class T>
  static MetaImage of(std::vector<std::size_t> size, std::vector<double> spacing, std::vector<double> origin,
                      std::span<const T> samples, std::size_t channels = 1);
};

// Throws FileError naming the file, the header field and the remedy.
MetaImage read_metaimage(const std::filesystem::path& path);

// Throws FileError when it cannot be written, std::invalid_argument when the image is inconsistent.
void write_metaimage(const std::filesystem::path& path, const MetaImage& image);

template <class T>
std::vector<T> MetaImage::as() const {
  std::vector<T> out(values());
  const auto convert = [&]<class S>(S) {
    if constexpr (std::is_same_v<S, T>) {
      if (!out.empty()) std::memcpy(out.data(), data.data(), out.size() * sizeof(T));
    } else {
      for (std::size_t i = 0; i < out.size(); ++i) {
        S value;
        std::memcpy(&value, data.data() + i * sizeof(S), sizeof(S));
        out[i] = static_cast<T>(value);
      }
    }
  };
  switch (type) {
    case ElementType::kUint8:
      convert(std::uint8_t{});
      break;
    case ElementType::kInt16:
      convert(std::int16_t{});
      break;
    case ElementType::kFloat32:
      convert(float{});
      break;
    case ElementType::kFloat64:
      convert(double{});
      break;
  }
  return out;
}

template <class T>
MetaImage MetaImage::of(std::vector<std::size_t> size, std::vector<double> spacing,
                        std::vector<double> origin, std::span<const T> samples, std::size_t channels) {
  MetaImage image{
      std::move(size), std::move(spacing), std::move(origin), channels, element_type_of<T>(), {}, {}};
  if (samples.size() != image.values())
    throw std::invalid_argument("MetaImage::of: samples do not fill size x channels");
  image.data.resize(samples.size_bytes());
  if (!samples.empty()) std::memcpy(image.data.data(), samples.data(), samples.size_bytes());
  return image;
}

}  // namespace teletact::client
