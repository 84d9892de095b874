#include "client/files/metaimage.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <string_view>

#include "client/text/shown.h"

namespace teletact::client {

static_assert(std::endian::native == std::endian::little, "samples are written as they lie in memory");

namespace {

constexpr std::size_t kLargestHeaderBytes = 64 * 1024;
constexpr std::size_t kLargestDimension = std::size_t{1} << 24;
constexpr std::size_t kLargestChannels = 4096;

struct TypeName {
  ElementType type;
  const char* name;
  std::size_t bytes;
};
constexpr std::array<TypeName, 4> kTypes{{{ElementType::kUint8, "MET_UCHAR", 1},
                                          {ElementType::kInt16, "MET_SHORT", 2},
                                          {ElementType::kFloat32, "MET_FLOAT", 4},
                                          {ElementType::kFloat64, "MET_DOUBLE", 8}}};

const TypeName& type_name(ElementType type) {
  return *std::find_if(kTypes.begin(), kTypes.end(), [&](const TypeName& t) { return t.type == type; });
}

// The header's fields, and where the samples begin.
struct Header {
  std::map<std::string, std::string> fields;
  std::size_t bytes = 0;
};

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t\r");
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
}

Header read_header(const std::filesystem::path& path, std::ifstream& in) {
  std::string head(kLargestHeaderBytes, '\0');
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(in.gcount()));
  in.clear();
  Header header;
  for (std::size_t end; (end = head.find('\n', header.bytes)) != std::string::npos;) {
    const std::string line = head.substr(header.bytes, end - header.bytes);
    header.bytes = end + 1;
    const auto equals = line.find('=');
    if (equals == std::string::npos) break;
    const std::string key = trimmed(line.substr(0, equals));
    if (!header.fields.emplace(key, trimmed(line.substr(equals + 1))).second)
      throw FileError(path, "header field " + shown(key) + " is given twice; keep one");
    if (key == "ElementDataFile") return header;  // by definition the last one
  }
  throw FileError(path, "is no MetaImage: its header has no ElementDataFile line; give an .mha file");
}

// Numbers of one field; exactly `count` of them, all finite.
std::vector<double> numbers(const std::filesystem::path& path, const Header& header, const std::string& key,
                            std::size_t count) {
  std::istringstream in(header.fields.at(key));
  std::vector<double> values;
  for (std::string word; in >> word;) {
    char* end = nullptr;
    const double value = std::strtod(word.c_str(), &end);
    if (*end != '\0' || !std::isfinite(value))
      throw FileError(path,
                      "header field " + key + ": '" + shown(word) + "' is no number; correct the header");
    values.push_back(value);
  }
  if (values.size() != count)
    throw FileError(path, "header field " + key + " has " + std::to_string(values.size()) + " values, not " +
                              std::to_string(count) + "; correct the header");
  return values;
}

std::size_t whole(const std::filesystem::path& path, const std::string& key, double value,
                  std::size_t largest) {
  if (!(value >= 1) || value > static_cast<double>(largest) || value != std::floor(value))
    throw FileError(path, "header field " + key + " must be a whole number from 1 to " +
                              std::to_string(largest) + "; correct the header");
  return static_cast<std::size_t>(value);
}

void refuse_unfaithful(const std::filesystem::path& path, const Header& header) {
  // As MetaIO reads it: by the first letter.
  const auto is_true = [&](const char* key, bool where_absent) {
    const auto found = header.fields.find(key);
    if (found == header.fields.end()) return where_absent;
    return !found->second.empty() &&
           std::string_view("Tt1").find(found->second.front()) != std::string_view::npos;
  };
  if (is_true("CompressedData", false))
    throw FileError(path, "CompressedData = True is not supported; save it uncompressed");
  if (!is_true("BinaryData", true))
    throw FileError(path, "BinaryData = False is not supported; save it as binary");
  if (is_true("BinaryDataByteOrderMSB", false) || is_true("ElementByteOrderMSB", false))
    throw FileError(path, "big-endian samples are not supported; save it little-endian");
  if (header.fields.at("ElementDataFile") != "LOCAL")
    throw FileError(path,
                    "ElementDataFile must be LOCAL (samples in the same file); convert it to one .mha file");
}

// A rotated image would be read with wrong axes: only the identity is accepted.
void check_transform(const std::filesystem::path& path, const Header& header, std::size_t dimensions) {
  for (const std::string key : {"TransformMatrix", "Rotation", "Orientation"}) {  // MetaIO's names for one
    if (!header.fields.contains(key)) continue;
    const auto matrix = numbers(path, header, key, dimensions * dimensions);
    for (std::size_t i = 0; i < matrix.size(); ++i)
      if (matrix[i] != (i % (dimensions + 1) == 0 ? 1.0 : 0.0))
        throw FileError(path, key + " is not the identity; resample the image to its own axes");
  }
}

MetaImage described(const std::filesystem::path& path, const Header& header) {
  for (const char* key : {"NDims", "DimSize", "ElementType"})
    if (!header.fields.contains(key))
      throw FileError(path, std::string("header field ") + key + " is missing; add it");
  refuse_unfaithful(path, header);
  const std::size_t dimensions = whole(path, "NDims", numbers(path, header, "NDims", 1)[0], 3);
  if (dimensions < 2) throw FileError(path, "NDims must be 2 or 3; give an image of A-lines");
  check_transform(path, header, dimensions);
  MetaImage image;
  for (const double n : numbers(path, header, "DimSize", dimensions))
    image.size.push_back(whole(path, "DimSize", n, kLargestDimension));
  if (header.fields.contains("ElementNumberOfChannels"))
    image.channels = whole(path, "ElementNumberOfChannels",
                           numbers(path, header, "ElementNumberOfChannels", 1)[0], kLargestChannels);
  const std::string& name = header.fields.at("ElementType");
  const auto type =
      std::find_if(kTypes.begin(), kTypes.end(), [&](const TypeName& t) { return name == t.name; });
  if (type == kTypes.end())
    throw FileError(path, "ElementType " + shown(name) +
                              " is not supported; use MET_SHORT, MET_FLOAT, MET_DOUBLE or MET_UCHAR");
  image.type = type->type;
  if (header.fields.contains("ElementSpacing")) {
    image.spacing = numbers(path, header, "ElementSpacing", dimensions);
    for (const double s : image.spacing)
      if (!(s > 0)) throw FileError(path, "header field ElementSpacing must be positive; correct the header");
  }
  for (const char* key : {"Offset", "Position", "Origin"})
    if (image.origin.empty() && header.fields.contains(key))
      image.origin = numbers(path, header, key, dimensions);
  return image;
}

// Bytes the header asks for, without overflow: 3 x 24 bits of dimensions x 12 of channels x 4 can exceed 64.
long double declared_bytes(const MetaImage& image) {
  long double bytes = static_cast<long double>(image.channels * element_bytes(image.type));
  for (const std::size_t n : image.size) bytes *= static_cast<long double>(n);
  return bytes;
}

}  // namespace

std::size_t element_bytes(ElementType type) {
  return type_name(type).bytes;
}

std::size_t MetaImage::values() const {
  std::size_t n = channels;
  for (const std::size_t s : size) n *= s;
  return n;
}

MetaImage read_metaimage(const std::filesystem::path& path) {
  const std::size_t file_bytes = readable_file_size(path);
  std::ifstream in(path, std::ios::binary);
  const Header header = read_header(path, in);
  MetaImage image = described(path, header);
  const long double declared = declared_bytes(image);
  const std::size_t present = file_bytes - header.bytes;
  if (declared != static_cast<long double>(present)) {
    char problem[200];
    std::snprintf(
        problem, sizeof problem,
        "its header declares %.0Lf bytes of samples but %zu follow; the file is %s: copy or export it again",
        declared, present, declared > static_cast<long double>(present) ? "truncated" : "corrupt");
    throw FileError(path, problem);
  }
  image.data.resize(present);
  in.seekg(static_cast<std::streamoff>(header.bytes));
  in.read(reinterpret_cast<char*>(image.data.data()), static_cast<std::streamsize>(present));
  if (static_cast<std::size_t>(in.gcount()) != present)
    throw FileError(path, "could not be read to its end; check the disk");
  return image;
}

void write_metaimage(const std::filesystem::path& path, const MetaImage& image) {
  const std::size_t dimensions = image.size.size();
  if (dimensions < 2 || dimensions > 3)
    throw std::invalid_argument("MetaImage.size must have 2 or 3 dimensions");
  if (image.data.size() != image.values() * element_bytes(image.type))
    throw std::invalid_argument("MetaImage.data does not fill size x channels");
  for (const auto* list : {&image.spacing, &image.origin})
    if (!list->empty() && list->size() != dimensions)
      throw std::invalid_argument("MetaImage.spacing and origin need one value per dimension");
  const auto listed = [](const char* key, const auto& values) {
    std::ostringstream out;
    out.precision(17);
    out << key << " =";
    for (const auto v : values) out << ' ' << v;
    out << '\n';
    return out.str();
  };
  std::string header = "ObjectType = Image\nNDims = " + std::to_string(dimensions) +
                       "\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n";
  if (!image.origin.empty()) header += listed("Offset", image.origin);
  if (!image.spacing.empty()) header += listed("ElementSpacing", image.spacing);
  header += listed("DimSize", image.size);
  if (image.channels > 1) header += "ElementNumberOfChannels = " + std::to_string(image.channels) + "\n";
  header += std::string("ElementType = ") + type_name(image.type).name + "\nElementDataFile = LOCAL\n";
  write_file(path, header, image.data);
}

}  // namespace teletact::client
