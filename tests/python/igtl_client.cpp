// A client by the OpenIGTLink library itself: igtl_client PORT. Sends a STATUS, prints the newest IMAGE,
// TRANSFORM and STRING once it has all three, and fails where one does not unpack with its CRC.
#include <igtlClientSocket.h>
#include <igtlImageMessage.h>
#include <igtlMessageHeader.h>
#include <igtlStatusMessage.h>
#include <igtlStringMessage.h>
#include <igtlTransformMessage.h>

#include <cstdio>
#include <cstdlib>
#include <set>
#include <string>

namespace {

template <typename Message>
typename Message::Pointer body_of(igtl::ClientSocket& socket, igtl::MessageHeader::Pointer header) {
  auto message = Message::New();
  message->SetMessageHeader(header);
  message->AllocatePack();
  socket.Receive(message->GetPackBodyPointer(), message->GetPackBodySize());
  if (!(message->Unpack(1) & igtl::MessageHeader::UNPACK_BODY)) {
    std::printf("%s does not unpack\n", header->GetDeviceType());
    std::exit(1);
  }
  return message;
}

}  // namespace

int main(int, char** argv) {
  auto socket = igtl::ClientSocket::New();
  if (socket->ConnectToServer("127.0.0.1", std::atoi(argv[1])) != 0) return 2;
  auto status = igtl::StatusMessage::New();
  status->SetDeviceName("client");
  status->SetCode(igtl::StatusMessage::STATUS_OK);
  status->Pack();
  socket->Send(status->GetPackPointer(), status->GetPackSize());
  std::set<std::string> had;
  while (had.size() < 3) {
    auto header = igtl::MessageHeader::New();
    header->InitPack();
    if (socket->Receive(header->GetPackPointer(), header->GetPackSize()) <= 0) return 3;
    header->Unpack();
    const std::string type = header->GetDeviceType();
    had.insert(type);
    igtl::Matrix4x4 matrix;
    if (type == "IMAGE") {
      auto image = body_of<igtl::ImageMessage>(*socket, header);
      int size[3];
      float spacing[3];
      image->GetDimensions(size);
      image->GetSpacing(spacing);
      image->GetMatrix(matrix);
      const auto* values = static_cast<const float*>(image->GetScalarPointer());
      std::printf("IMAGE %s %d %d %d %.4f %.4f %.4f at %.4f %.4f %.4f: %.1f %.1f type %d endian %d axes %d\n",
                  header->GetDeviceName(), size[0], size[1], size[2], spacing[0], spacing[1], spacing[2],
                  matrix[0][3], matrix[1][3], matrix[2][3], values[0], values[size[0] * size[1] - 1],
                  image->GetScalarType(), image->GetEndian(), image->GetCoordinateSystem());
    } else if (type == "TRANSFORM") {
      body_of<igtl::TransformMessage>(*socket, header)->GetMatrix(matrix);
      std::printf("TRANSFORM %s %.4f %.4f %.4f %.1f\n", header->GetDeviceName(), matrix[0][3], matrix[1][3],
                  matrix[2][3], matrix[2][2]);
    } else if (type == "STRING") {
      std::printf("STRING %s %s\n", header->GetDeviceName(),
                  body_of<igtl::StringMessage>(*socket, header)->GetString());
    } else {
      std::printf("%s was not expected\n", type.c_str());
      return 4;
    }
  }
  socket->CloseSocket();
}
