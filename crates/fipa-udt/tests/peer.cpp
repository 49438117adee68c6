// A program on libudt alone, as a C++ robot uses it: sends letters from files, writes the letters
// that it receives to files, or passes them on.
//
//   peer send PORT FILE...        connects to 127.0.0.1, one message a file
//   peer receive COUNT PREFIX     prints its port, writes PREFIX0, PREFIX1, …
//   peer relay COUNT PORT         prints its port, sends what it receives to 127.0.0.1

#include <arpa/inet.h>
#include <udt/udt.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <iterator>
#include <string>
#include <vector>

static int fail(const char* what) {
    std::cerr << what << ": " << UDT::getlasterror().getErrorMessage() << std::endl;
    return 1;
}

int main(int argc, char** argv) {
    std::string mode = argc > 2 ? argv[1] : "";
    sockaddr_in address;
    std::memset(&address, 0, sizeof address);
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    UDTSOCKET socket = UDT::socket(AF_INET, SOCK_DGRAM, 0);
    int buffer = 10000000;
    UDT::setsockopt(socket, 0, UDT_RCVBUF, &buffer, sizeof buffer);
    sockaddr_in onward = address;
    if (mode == "send") {
        address.sin_port = htons(std::atoi(argv[2]));
        if (UDT::connect(socket, (sockaddr*)&address, sizeof address) == UDT::ERROR) {
            return fail("connect");
        }
        for (int i = 3; i < argc; i++) {
            std::ifstream file(argv[i], std::ios::binary);
            std::vector<char> letter((std::istreambuf_iterator<char>(file)),
                                     std::istreambuf_iterator<char>());
            if (UDT::sendmsg(socket, letter.data(), letter.size(), -1, true) == UDT::ERROR) {
                return fail("send");
            }
        }
        // What is not yet sent is lost with the process.
        sleep(1);
        return 0;
    }
    if (UDT::bind(socket, (sockaddr*)&address, sizeof address) == UDT::ERROR ||
        UDT::listen(socket, 5) == UDT::ERROR) {
        return fail("listen");
    }
    int length = sizeof address;
    UDT::getsockname(socket, (sockaddr*)&address, &length);
    std::cout << ntohs(address.sin_port) << std::endl;
    UDTSOCKET caller = UDT::accept(socket, (sockaddr*)&address, &length);
    if (caller == UDT::INVALID_SOCK) {
        return fail("accept");
    }
    bool relays = mode == "relay";
    UDTSOCKET next = UDT::socket(AF_INET, SOCK_DGRAM, 0);
    onward.sin_port = htons(std::atoi(argv[3]));
    if (relays && UDT::connect(next, (sockaddr*)&onward, sizeof onward) == UDT::ERROR) {
        return fail("connect");
    }
    std::vector<char> letter(buffer);
    for (int i = 0; i < std::atoi(argv[2]); i++) {
        int count = UDT::recvmsg(caller, letter.data(), letter.size());
        if (count == UDT::ERROR) {
            return fail("receive");
        }
        if (relays) {
            if (UDT::sendmsg(next, letter.data(), count, -1, true) == UDT::ERROR) {
                return fail("send");
            }
            continue;
        }
        std::ofstream(argv[3] + std::to_string(i), std::ios::binary).write(letter.data(), count);
        std::cout << count << std::endl;
    }
    // Until whoever started it has seen enough.
    pause();
    return 0;
}
