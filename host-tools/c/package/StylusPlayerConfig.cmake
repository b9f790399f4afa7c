# find_package(StylusPlayer) gives the targets StylusPlayer::StylusPlayer, the shared library, and StylusPlayer::Static.
get_filename_component(_stylus_player "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET StylusPlayer::StylusPlayer)
    add_library(StylusPlayer::StylusPlayer SHARED IMPORTED)
    add_library(StylusPlayer::Static STATIC IMPORTED)
    set_target_properties(StylusPlayer::StylusPlayer StylusPlayer::Static
        PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${_stylus_player}/include")
    if(WIN32)
        set(_stylus_import libstylusplayer.dll.a)
        if(MSVC)
            set(_stylus_import stylusplayer.lib)
        endif()
        set_target_properties(StylusPlayer::StylusPlayer PROPERTIES
            IMPORTED_LOCATION "${_stylus_player}/bin/stylusplayer.dll"
            IMPORTED_IMPLIB "${_stylus_player}/lib/${_stylus_import}")
        set_property(TARGET StylusPlayer::Static PROPERTY INTERFACE_LINK_LIBRARIES kernel32 ntdll userenv ws2_32 bcrypt)
    else()
        set_target_properties(StylusPlayer::StylusPlayer PROPERTIES
            IMPORTED_LOCATION "${_stylus_player}/lib/libstylusplayer.so")
        find_package(Threads REQUIRED)
        set_property(TARGET StylusPlayer::Static
            PROPERTY INTERFACE_LINK_LIBRARIES Threads::Threads m ${CMAKE_DL_LIBS})
    endif()
    set_property(TARGET StylusPlayer::Static PROPERTY IMPORTED_LOCATION "${_stylus_player}/lib/libstylusplayer.a")
endif()
unset(_stylus_player)
unset(_stylus_import)
