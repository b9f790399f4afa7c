// A player that is disposed of while another thread fills is silent from then on, and throws nothing.
// Usage: Closed.exe LIBRARY
using System;
using System.Threading;
using Stylus;

static class Closed
{
    static int Main(string[] arguments)
    {
        using (var library = new Library(arguments[0]))
        {
            for (int time = 0; time < 300; time++)
            {
                var player = new Player(48000);
                player.Choose(library, library.Textures[0]);
                player.SetCoil(8, 0.01f, 0.1f);
                if (player.BandHz(5000) != 2000) throw new Exception("the band is another");
                Exception thrown = null;
                bool begun = false;
                var samples = new float[64];
                var audio = new Thread(() =>
                {
                    try
                    {
                        // It plays until Dispose, and the part that it then gets is silent.
                        while (player.Fill(samples, 0, samples.Length)) Volatile.Write(ref begun, true);
                    }
                    catch (Exception failure) { thrown = failure; }
                });
                audio.Start();
                while (!Volatile.Read(ref begun) && audio.IsAlive) Thread.Yield();
                player.Dispose();
                audio.Join();
                samples[0] = 1;
                bool isPlayed = thrown == null && player.Fill(samples, 0, samples.Length);
                if (thrown == null && !isPlayed && Array.TrueForAll(samples, sample => sample == 0)) continue;
                Console.Error.WriteLine(thrown == null ? "a closed player is not silent" : thrown.ToString());
                return 1;
            }
        }
        return 0;
    }
}
