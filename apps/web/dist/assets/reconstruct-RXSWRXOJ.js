import"./chunk-KHNENPYX.js";import{O as e,y as t}from"./chunk-EXJ3EDRR.js";function o(){return t(e,{title:"Reconstruct",text:"This page is being built."})}export{o as Reconstruct};
