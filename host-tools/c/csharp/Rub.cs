// Plays a texture under a steady motion to a file of 32-bit floats, m/s²: Rub.exe LIBRARY TEXTURE MM_S N SECONDS OUT
// At 5000 Hz the samples are those of `stylus render` with seed 1, to the bit.
using System;
using System.Globalization;
using System.IO;
using Stylus;

static class Rub
{
    const int RateHz = 5000, Block = RateHz / 500;

    static int Main(string[] arguments)
    {
        if (arguments.Length != 6)
        {
            Console.Error.WriteLine("usage: Rub LIBRARY TEXTURE MM_S N SECONDS OUT");
            return 2;
        }
        Func<int, double> number = index => double.Parse(arguments[index], CultureInfo.InvariantCulture);
        double speed = number(2), force = number(3);
        int blocks = (int)(number(4) * RateHz / Block);
        try
        {
            using (var library = new Library(arguments[0]))
            using (var player = new Player(RateHz, asRendered: true))
            using (var file = new BinaryWriter(File.Create(arguments[5])))
            {
                player.Choose(library, arguments[1]);
                var samples = new float[Block];
                for (int block = 0; block < blocks; block++)
                {
                    player.Move(speed, force);
                    // In two parts, as a ring of an audio system asks for them.
                    if (!player.Fill(samples, 0, 3) || !player.Fill(samples, 3, Block - 3)) return 1;
                    foreach (float sample in samples) file.Write(sample);
                }
            }
        }
        catch (StylusException failure)
        {
            Console.Error.WriteLine(failure.Message);
            return 1;
        }
        return 0;
    }
}
