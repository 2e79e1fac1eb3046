import"./chunk-VSDYETHS.js";import{O as t,y as e}from"./chunk-ZJKHKGPO.js";function o(){return e(t,{title:"Explore",text:"This page is being built."})}export{o as Explore};
