#include "client/files/vti.h"

#include <bit>
#include <cstring>
#include <span>
#include <sstream>

namespace teletact::client {

static_assert(std::endian::native == std::endian::little, "byte_order below says LittleEndian");

namespace {

void append_base64(std::string& out, std::span<const unsigned char> bytes) {
  static constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  out.reserve(out.size() + (bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = bytes.size() - i;
    const unsigned triple = unsigned{bytes[i]} << 16 | (left > 1 ? unsigned{bytes[i + 1]} << 8 : 0u) |
                            (left > 2 ? unsigned{bytes[i + 2]} : 0u);
    out += kDigits[triple >> 18 & 63];
    out += kDigits[triple >> 12 & 63];
    out += left > 1 ? kDigits[triple >> 6 & 63] : '=';
    out += left > 2 ? kDigits[triple & 63] : '=';
  }
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  return out;
}

// <DataArray>: base64 of the byte count (UInt64) and the values, in one piece as VTK expects when
// uncompressed.
template <class T>
void append_array(std::string& xml, const VtiArray& array, const std::vector<T>& values) {
  const char* type = sizeof(T) == 1 ? "UInt8" : "Float32";
  std::ostringstream tag;
  tag << "        <DataArray type=\"" << type << "\" Name=\"" << escaped(array.name)
      << "\" NumberOfComponents=\"" << array.components << "\" format=\"binary\">\n";
  xml += tag.str();
  const std::uint64_t bytes = values.size() * sizeof(T);
  std::vector<unsigned char> block(sizeof bytes + bytes);
  std::memcpy(block.data(), &bytes, sizeof bytes);
  if (bytes > 0) std::memcpy(block.data() + sizeof bytes, values.data(), bytes);
  append_base64(xml, block);
  xml += "\n        </DataArray>\n";
}

std::string header(const VtiGrid& grid) {
  std::ostringstream extent, out;
  for (std::size_t d = 0; d < 3; ++d) extent << (d ? " " : "") << "0 " << grid.size[d] - 1;
  out.precision(17);
  out << "<?xml version=\"1.0\"?>\n"
         "<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n"
      << "  <ImageData WholeExtent=\"" << extent.str() << "\" Origin=\"" << grid.origin_m[0] << ' '
      << grid.origin_m[1] << ' ' << grid.origin_m[2] << "\" Spacing=\"" << grid.spacing_m[0] << ' '
      << grid.spacing_m[1] << ' ' << grid.spacing_m[2] << "\">\n    <Piece Extent=\"" << extent.str()
      << "\">\n      <PointData>\n";
  return out.str();
}

}  // namespace

void write_vti(const std::filesystem::path& path, const VtiGrid& grid, const std::vector<VtiArray>& arrays) {
  if (grid.points() == 0) throw std::invalid_argument("VtiGrid.size must be at least 1 in each dimension");
  std::string xml = header(grid);
  for (const VtiArray& array : arrays)
    std::visit(
        [&](const auto& values) {
          if (values.size() != grid.points() * array.components)
            throw std::invalid_argument("VtiArray '" + array.name + "' does not fit the grid");
          append_array(xml, array, values);
        },
        array.values);
  xml += "      </PointData>\n    </Piece>\n  </ImageData>\n</VTKFile>\n";
  write_file(path, xml);
}

}  // namespace teletact::client
